"""``haptix stimuli``: make, show and run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isnan
from pathlib import Path
from typing import Annotated, Any

import typer

from haptix.arguments import (
    device_address,
    folder,
    is_there,
    number,
    numbers,
    read_numbers,
    refuse_input,
)
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
    workers: Annotated[
        int,
        typer.Option(
            help="Processes that make files, for sets of hundreds; the bytes do not depend on it.",
            callback=number(least=1, most=256),
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
            from concurrent.futures import ProcessPoolExecutor
            from multiprocessing import get_context

            with ProcessPoolExecutor(workers, get_context("spawn")) as executor:
                result = parts.make(place, 1, update, executor)
    rows = [dict(one) for one in result.sidecars] if as_json else [*map(_row, result.sidecars)]
    again = f", {result.reused} of them from an earlier run" if result.reused else ""
    show(f"{len(rows)} stimuli in {result.folder}{again}", rows, as_json)


@app.command()
def again(
    sidecar: Annotated[
        Path, typer.Argument(help="Sidecar of a drive file (NAME.json).", callback=is_there)
    ],
    out: Annotated[Path, typer.Option(help="Drive file to write.")],
) -> None:
    """Make a drive file again from its sidecar and profiles.json; every byte must be the same."""
    from haptix.stimuli.again import make_again

    show(f"{make_again(sidecar, out)}: the same, byte for byte", [], False)


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
    participant: Annotated[
        int,
        typer.Option(
            help="Number from 1, which decides the order of blocks.", callback=number(least=1)
        ),
    ] = 1,
    another_program: Annotated[
        bool, typer.Option(help="Continue a log that another version of haptix began.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Run an adaptive experiment on a device; keys answer, as the task says (1/2, l/r, y/n, s/d).

    With --simulate-db a simulated observer answers and nothing waits.
    """
    from haptix.devices import open_device
    from haptix.stimuli.adaptive import TASKS, Experiment, Keys, SimulatedObserver
    from haptix.stimuli.experiment_recipe import ExperimentRecipe

    plan = ExperimentRecipe.load(recipe)
    opened = open_device(device)
    try:
        keys, answer = Keys(), None
        surroundings: dict[str, Any] = {"rest": keys.rest, "tell": keys.tell}
        if simulate_db is not None:
            guess = TASKS[plan.task].guess or 0.05
            answer = SimulatedObserver(simulate_db, guess=guess, seed=plan.seed)
            surroundings = {"wait": lambda seconds: None}
        experiment = Experiment(
            plan.make_method(participant),
            plan.presentations(opened.capabilities.sample_rate_hz),
            opened,
            keys if answer is None else answer,
            log,
            plan.task,
            plan.seed,
            plan.ceiling_v,
            plan.pause_s,
            another_program=another_program,
            plan=plan.session_plan(),
            **surroundings,
        )
        experiment.run()
    finally:
        opened.close()
    rows, warnings = [], []
    for name, found in experiment.estimates().items():
        row = {
            **({"condition": name} if name else {}),
            "trials": experiment.trials,
            "threshold_db": _known(found.threshold),
            "spread_db": _known(found.spread),
            **{key: _known(value) for key, value in found.others.items()},
            **experiment.summary(),
        }
        warnings += [f"{name}: {line}" if name else line for line in found.warnings]
        rows.append({**row, "warnings": list(found.warnings)} if as_json else row)
    show("; warning: ".join((f"{plan.name}: trials in {log}", *warnings)), rows, as_json)


@app.command()
def simulate(
    recipe: Annotated[Path, typer.Argument(help="Experiment: a TOML file.", callback=is_there)],
    threshold_db: Annotated[
        str, typer.Option(help="Thresholds of the observers [dB].", callback=numbers())
    ],
    slope: Annotated[
        str, typer.Option(help="Slopes of the observers.", callback=numbers(above=0))
    ] = "1.5,3.5",
    lapse: Annotated[
        str, typer.Option(help="Lapse rates of the observers.", callback=numbers(least=0))
    ] = "0.02,0.08",
    runs: Annotated[
        int, typer.Option(help="Runs of each observer.", callback=number(least=10, most=100_000))
    ] = 200,
    participants: Annotated[
        str | None, typer.Option(help="Sample sizes whose power is asked for, such as 8,12,16.")
    ] = None,
    difference_db: Annotated[
        float, typer.Option(help="Difference of two conditions [dB].", callback=number())
    ] = 2.0,
    between_db: Annotated[
        float,
        typer.Option(help="Spread of thresholds between people [dB].", callback=number(least=0)),
    ] = 3.0,
    as_json: AsJson = False,
) -> None:
    """Simulate a plan before anybody sits: what its thresholds are worth, and its power.

    Rows: bias, scatter, the spread that is stated, and how often there is no threshold or a
    warning, for observers of each threshold, slope and lapse rate. With --participants: how often a
    paired t-test finds a difference between two conditions.
    """
    from haptix.stimuli.adaptive.tasks import TASKS
    from haptix.stimuli.experiment_recipe import ExperimentRecipe
    from haptix.stimuli.power import Observer, accuracy, paired_power

    plan = ExperimentRecipe.load(recipe)
    guess = TASKS[plan.task].guess or 0.05
    if plan.task in ("pairs", "magnitude"):
        raise InputError(f"simulate: the task {plan.task!r} measures no threshold")
    base = plan.model_copy(update={"conditions": ()})
    thresholds, slopes, lapses = (
        read_numbers(name, text)
        for name, text in (
            ("--threshold-db", threshold_db), ("--slope", slope), ("--lapse", lapse),
        )
    )  # fmt: skip
    if participants is None:
        rows = [
            accuracy(base.make_method, Observer(at, steep, lapses_by, guess), runs, plan.seed)
            for at in thresholds
            for steep in slopes
            for lapses_by in lapses
        ]
        title = f"{plan.name}: {runs} runs of each observer"
    else:
        sizes = [int(size) for size in read_numbers("--participants", participants)]
        observer = Observer(thresholds[0], slopes[-1], lapses[0], guess)
        rows = [
            *paired_power(
                base.make_method, observer, difference_db, between_db, sizes, runs, plan.seed
            )
        ]
        title = f"{plan.name}: power of a paired t-test at 0.05, of {runs} simulated participants"
    shown = [
        {key: round(value, 3) if isinstance(value, float) else value for key, value in row.items()}
        for row in rows
    ]
    show(title, rows if as_json else shown, as_json)


@app.command()
def new(
    study: Annotated[Path, typer.Argument(help="Folder that is not there yet.", callback=folder)],
    as_json: AsJson = False,
) -> None:
    """Begin a study: code/experiment.toml to change, and the frame of a BIDS data set."""
    from haptix.stimuli.bids import begin

    rows = [{"file": str(path)} for path in begin(study, study.absolute().name)]
    show(f"{study}: change code/experiment.toml, then simulate and run it", rows, as_json)


@app.command()
def bids(
    log: Annotated[Path, typer.Argument(help="Log of `haptix stimuli run`.", callback=is_there)],
    study: Annotated[Path, typer.Option(help="Folder of the data set.", callback=folder)],
    participant: Annotated[str, typer.Option(help="Pseudonym: letters and digits.")],
    session: Annotated[str, typer.Option(help="Label of the session.")] = "01",
    task: Annotated[str, typer.Option(help="Label of the task.")] = "detection",
    as_json: AsJson = False,
) -> None:
    """Write a log into a study in the Brain Imaging Data Structure (BIDS).

    Behaviour of every attempt, the stimulus against time, and where the panel reports touches the
    finger's path and force; the log itself goes to sourcedata.
    """
    from haptix.stimuli.bids import export

    files = export(log, study, participant, session, task)
    rows = [{"file": str(path)} for path in files]
    show(f"{len(rows)} files of sub-{participant} in {study}", rows, as_json)


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
