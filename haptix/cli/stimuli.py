"""``haptix stimuli``: make, show and run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isnan
from pathlib import Path
from typing import Annotated, Any

import typer

from haptix.arguments import device_address, folder, is_there, number, refuse_input
from haptix.errors import InputError
from haptix.terminal import AsJson, breakdown_note, progress_bar, show

app = typer.Typer(
    help="Stimuli for perception experiments: make sets, look at them, run trials.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)

_STAGES = {
    "surface": "build the friction surfaces",
    "render": "render and check",
    "write": "publish, draw the sheet",
}


@app.command()
def make(
    recipe: Annotated[Path, typer.Argument(help="Set of stimuli: a TOML file.", callback=is_there)],
    out: Annotated[
        Path | None, typer.Option(help="Folder. [default: the set's name]", callback=folder)
    ] = None,
    threads: Annotated[
        int,
        typer.Option(
            help="Threads; the bytes do not depend on it.", callback=number(least=1, most=256)
        ),
    ] = 2,
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
        result = parts.make(place, threads, update)
    rows = [dict(one) for one in result.sidecars] if as_json else [*map(_row, result.sidecars)]
    again = f", {result.reused} of them from an earlier run" if result.reused else ""
    show(f"{len(rows)} stimuli in {result.folder}{again}", rows, as_json)


@app.command("show")
def look(
    what: Annotated[Path, typer.Argument(help="Drive file, or folder of a set.")],
    out: Annotated[
        Path | None, typer.Option(help="Picture of a drive file. [default: its name + .png]")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Draw a stimulus (waveform, spectrum, friction, thresholds, audibility), or check a set."""
    from haptix.files import read_json, reading, write_whole

    if what.is_dir():
        from haptix.stimuli.making import check_manifest, read_manifest

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


@app.command()
def run(
    recipe: Annotated[Path, typer.Argument(help="Experiment: a TOML file.", callback=is_there)],
    log: Annotated[Path, typer.Option(help="Table of the trials; continued if it exists.")],
    device: Annotated[
        str, typer.Option(help="Address of the device.", callback=device_address)
    ] = "mock:",
    simulate_db: Annotated[
        float | None,
        typer.Option(
            "--simulate-db",
            help="Simulate an observer of this threshold [dB].",
            callback=number(),
        ),
    ] = None,
    another_program: Annotated[
        bool, typer.Option(help="Continue a log that another version of haptix began.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Run an adaptive experiment on a device; keys answer (1/2, or l/r).

    With --simulate-db a simulated observer answers and nothing waits.
    """
    from haptix.devices import open_device
    from haptix.stimuli.adaptive import Experiment, Keys, SimulatedObserver
    from haptix.stimuli.experiment_recipe import ExperimentRecipe

    plan = ExperimentRecipe.load(recipe)
    opened = open_device(device)
    try:
        observer = None if simulate_db is None else SimulatedObserver(simulate_db, seed=plan.seed)
        method = plan.make_method()
        waiting: dict[str, Any] = {} if observer is None else {"wait": lambda seconds: None}
        experiment = Experiment(
            method,
            plan.presentation(opened.capabilities.sample_rate_hz),
            opened,
            Keys() if observer is None else observer,
            log,
            plan.task,
            plan.seed,
            plan.ceiling_v,
            plan.pause_s,
            another_program=another_program,
            **waiting,
        )
        experiment.run()
    finally:
        opened.close()
    found = method.estimate()
    row = {
        "trials": experiment.trials,
        "threshold_db": _known(found.threshold),
        "spread_db": _known(found.spread),
        **found.others,
    }
    title = "; warning: ".join((f"{plan.name}: trials in {log}", *found.warnings))
    show(title, [{**row, "warnings": list(found.warnings)} if as_json else row], as_json)


def _known(value: float) -> float | None:
    return None if isnan(value) else value


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
