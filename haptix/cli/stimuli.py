"""``haptix stimuli``: make, show and run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from haptix.cli import experiments
from haptix.desk import argument, option
from haptix.errors import InputError
from haptix.fields import FileOrFolder, FileThere, Folder, NewFile, refuse_input
from haptix.terminal import AsJson, breakdown_note, progress_bar, show

app = typer.Typer(
    help="Stimuli for perception experiments: make sets, look at them, run and analyse trials.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)
app.add_typer(experiments.app)

_STAGES = {
    "surface": "build the friction surfaces",
    "render": "render and check",
    "write": "publish, draw the sheet",
}


@app.command()
def make(
    recipe: Annotated[Path, argument("Set of stimuli: a TOML file.", FileThere)],
    out: Annotated[Path | None, option("Folder. [default: the set's name]", Folder)] = None,
    threads: Annotated[
        int, option("Threads; the bytes do not depend on it.", int, ge=1, le=256)
    ] = 2,
    workers: Annotated[
        int,
        option(
            "Processes that make files, for sets of hundreds; the bytes do not depend on it.",
            int,
            ge=1,
            le=256,
        ),
    ] = 1,
    as_json: AsJson = False,
) -> None:
    """Render a set: drive files with sidecars, trial table, contact sheet, manifest.

    Nothing is published unless all stimuli are within the limits and the reachable range. A run
    that was stopped continues where it ended.
    """
    with progress_bar(_STAGES) as update:
        update("surface", 0.0)
        from haptix.files import file_name
        from haptix.stimuli.recipe import Recipe

        parts = Recipe.load(recipe).stimulus_set()
        place = Path(file_name("name", parts.name)) if out is None else out
        if workers == 1:
            result = parts.make(place, threads, update)
        else:
            from haptix.campaign.processes import Processes

            with Processes(workers) as executor:
                result = parts.make(place, 1, update, executor)
    rows = [dict(one) for one in result.sidecars] if as_json else [*map(_row, result.sidecars)]
    again = f", {result.reused} of them from an earlier run" if result.reused else ""
    show(f"{len(rows)} stimuli in {result.folder}{again}", rows, as_json)


@app.command()
def again(
    sidecar: Annotated[Path, argument("Sidecar of a drive file (NAME.json).", FileThere)],
    out: Annotated[Path, option("Drive file to write.", NewFile)],
) -> None:
    """Make a drive file again from its sidecar and profiles.json; every byte must be the same."""
    from haptix.stimuli.stimulus_set import make_again

    show(f"{make_again(sidecar, out)}: the same, byte for byte", [], False)


@app.command("show")
def look(
    what: Annotated[Path, argument("Drive file, or folder of a set.", FileOrFolder)],
    out: Annotated[
        Path | None, option("Picture of a drive file. [default: its name + .png]", NewFile)
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Draw a stimulus (waveform, spectrum, friction, thresholds, audibility), or check a set."""
    from haptix.files import read_json, reading, write_whole

    if what.is_dir():
        from haptix.stimuli.stimulus_set import check_manifest, read_manifest

        wrong = check_manifest(what)
        if wrong:
            raise InputError(
                f"{what}: {len(wrong)} files are missing or differ from the manifest: "
                f"{', '.join(wrong[:5])}; make the set again"
            )
        manifest = read_manifest(what)
        with reading(what, "a set with its sidecars"):
            names = [name for name in manifest["files"] if name.endswith((".wav", ".flac"))]
            tables = [read_json((what / name).with_suffix(".json")) for name in names]
            rows = tables if as_json else [*map(_row, tables)]
            title = f"{manifest['set']}: all files are whole; sheet: {what / 'sheet.png'}"
        show(title + _current(tables) + breakdown_note(_past(tables)), rows, as_json)
        return
    from haptix.stimuli.drawing import draw_stimulus

    picture = what.with_suffix(".png") if out is None else out
    refuse_input(picture, what, what.with_suffix(".json"))
    write_whole(picture, draw_stimulus(what))
    table = read_json(what.with_suffix(".json"))
    with reading(what.with_suffix(".json"), "the sidecar of a stimulus"):
        row = table if as_json else _row(table)
        title = f"picture: {picture}{_current([table])}"
    show(title + breakdown_note(_past([table])), [row], as_json)


def _current(tables: Sequence[Mapping[str, Any]]) -> str:
    """Say the largest current that is expected beside its limits."""
    # Sidecars of earlier versions have none.
    currents = [table["current"] for table in tables if "current" in table]
    if not currents:
        return ""
    peak, rms = (
        f"{max(one[f'expected_{kind}_a'] for one in currents) * 1e3:.2g} mA "
        f"(limit {currents[0][f'limit_{kind}_a'] * 1e3:g})"
        for kind in ("peak", "rms")
    )
    return f"; current at most {peak}, {rms} rms"


def _past(tables: Sequence[Mapping[str, Any]]) -> float:
    """Largest share of the attraction past what gaps bear; earlier sidecars have none."""
    return max((float(table.get("pull_past_breakdown", 0.0)) for table in tables), default=0.0)


def _row(table: Mapping[str, Any]) -> dict[str, Any]:
    prediction, felt = table["predicted"], table["felt"]
    return {
        "file": table["file"],
        "s": f"{table['length_s']:.3g}",
        "peak V": f"{table['peak_v']:.1f}",
        "mu": f"{prediction['mu_low']:.3f}-{prediction['mu_high']:.3f}",
        "dB SL": "-" if felt is None else f"{felt['sensation_db']:+.1f}"
        + ("*" if felt["threshold_is_placeholder"] else ""),
        "past %": f"{100 * table.get('pull_past_breakdown', 0.0):.0f}",
        "audible": "yes" if table["audibility"]["audible"] else "no",
        "placeholders": "yes" if table["is_placeholder"] else "no",
    }  # fmt: skip
