"""``haptix stimuli``: begin a study, simulate, run and analyse experiments."""

from __future__ import annotations

import json
import re
from math import isnan
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import Field

from haptix.desk import argument, option
from haptix.errors import InputError
from haptix.fields import (
    Address,
    FileOrFolder,
    FileThere,
    Folder,
    Label,
    NewFile,
    NotNegative,
    Positive,
)
from haptix.terminal import AsJson, show

app = typer.Typer()


def _number_of(participant: str) -> int:
    """Return the number at the end of a pseudonym."""
    found = re.fullmatch(r"[A-Za-z0-9]*?([0-9]+)", participant)
    if found is None or len(participant) > 64 or not 1 <= int(found[1]) < 2**31:
        raise InputError(
            "--participant: expected letters and digits with a number from 1 at the end, such as "
            f"07 or p07, got {participant!r:.80}"
        )
    return int(found[1])


def _pseudonym(_: typer.CallbackParam, value: str | None) -> str | None:
    if value is not None:
        _number_of(value)
    return value


@app.command()
def run(
    recipe: Annotated[Path, argument("Experiment: a TOML file.", FileThere)],
    log: Annotated[
        Path | None, option("Table of the trials; continued if it exists.", NewFile)
    ] = None,
    study: Annotated[
        Path | None, option("Folder of a study, which gets the log and its BIDS files.", Folder)
    ] = None,
    device: Annotated[str, option("Address of the device.", Address)] = "mock:",
    simulate_db: Annotated[
        float | None, option("Simulate an observer of this threshold [dB].", float, "--simulate-db")
    ] = None,
    participant: Annotated[
        str | None,
        typer.Option(
            help="Pseudonym: letters and digits. The number at its end decides the order of "
            "blocks. [default, for a log: 1]",
            callback=_pseudonym,
        ),
    ] = None,
    session: Annotated[str, option("Label of the session in a study.", Label)] = "01",
    task: Annotated[
        str | None, option("Label of the task in a study. [default: the recipe's name]", Label)
    ] = None,
    another_program: Annotated[
        bool, typer.Option(help="Continue a log that another version of haptix began.")
    ] = False,
    lsl: Annotated[
        bool, typer.Option("--lsl", help="Send drive, touches and markers to Lab Streaming Layer.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Run an adaptive experiment on a device; keys answer, as the task says (1/2, l/r, y/n, s/d).

    Into a log, or with --study into a study: the same command continues a session that was stopped,
    and nothing of another is replaced. With --simulate-db a simulated observer answers and nothing
    waits.
    """
    if (log is None) == (study is None):
        raise InputError("run: expected either --log FILE or --study FOLDER")
    if study is not None and participant is None:
        raise InputError("--participant: a study needs one, such as 07")
    who = "1" if participant is None else participant
    place = _number_of(who)
    from haptix.devices import open_device
    from haptix.stimuli.adaptive import TASKS, Experiment, Keys, SimulatedObserver
    from haptix.stimuli.adaptive.session import seed_of
    from haptix.stimuli.recipe import ExperimentRecipe

    plan = ExperimentRecipe.load(recipe)
    seed, task, table = plan.seed, task or re.sub("[^A-Za-z0-9]", "", plan.name), log
    if study is not None:
        from haptix.stimuli.study import keep_recipe, session_log

        table = session_log(study, who, session, task)
        seed = seed_of(plan.seed, who, session)
        keep_recipe(recipe, table)
    assert table is not None
    opened, outlets = open_device(device), None
    try:
        if lsl:
            from haptix.render.lab_streams import LabOutlets

            outlets = LabOutlets(opened)
        keys, answer = Keys(), None
        surroundings: dict[str, Any] = {"rest": keys.rest, "tell": keys.tell}
        if simulate_db is not None:
            guess = TASKS[plan.task].guess or 0.05
            answer = SimulatedObserver(simulate_db, guess=guess, seed=seed)
            surroundings = {"wait": lambda seconds: None}
        experiment = Experiment(
            plan.make_method(place, None if study is None else seed),
            plan.presentations(opened.capabilities.sample_rate_hz),
            opened,
            keys if answer is None else answer,
            table,
            plan.task,
            seed,
            plan.ceiling_v,
            plan.pause_s,
            another_program=another_program,
            plan=plan.session_plan(),
            outlets=outlets,
            **surroundings,
        )
        try:
            experiment.run()
        finally:
            if study is not None and experiment.log.rows:
                from haptix.stimuli.study import export

                export(table, study, who, session, task)
    finally:
        if outlets is not None:
            outlets.close()
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
    show("; warning: ".join((f"{plan.name}: trials in {table}", *warnings)), rows, as_json)


@app.command()
def simulate(
    recipe: Annotated[Path, argument("Experiment: a TOML file.", FileThere)],
    threshold_db: Annotated[str, option("Thresholds of the observers [dB].", tuple[float, ...])],
    slope: Annotated[str, option("Slopes of the observers.", tuple[Positive, ...])] = "1.5,3.5",
    lapse: Annotated[
        str, option("Lapse rates of the observers.", tuple[NotNegative, ...])
    ] = "0.02,0.08",
    runs: Annotated[int, option("Runs of each observer.", int, ge=10, le=100_000)] = 200,
    participants: Annotated[
        str | None,
        option(
            "Sample sizes whose power is asked for, such as 8,12,16.",
            tuple[Annotated[int, Field(ge=2)], ...],
        ),
    ] = None,
    difference_db: Annotated[float, option("Difference of two conditions [dB].", float)] = 2.0,
    between_db: Annotated[
        float, option("Spread of thresholds between people [dB].", NotNegative)
    ] = 3.0,
    workers: Annotated[int, option("Processes that simulate.", int, ge=1, le=256)] = 1,
    as_json: AsJson = False,
) -> None:
    """Simulate a plan before anybody sits: what its thresholds are worth, and its power.

    Rows: bias, scatter, the spread that is stated, and how often there is no threshold or a
    warning, for observers of each threshold, slope and lapse rate. With --participants: how often a
    paired t-test finds a difference between two conditions.
    """
    from haptix.campaign.processes import Processes
    from haptix.executors import Here, finished
    from haptix.stimuli.power import simulated, simulations
    from haptix.stimuli.recipe import ExperimentRecipe

    plan = ExperimentRecipe.load(recipe)
    # What the options' checks have read, whose texts stand in the signature for Typer.
    observers: tuple[Any, Any, Any] = (threshold_db, slope, lapse)
    title, comparison = f"{plan.name}: {runs} runs of each observer", None
    if participants is not None:
        comparison = {
            "participants": [*participants],
            "difference": difference_db,
            "between": between_db,
        }
        observers = observers[0][:1], observers[1][-1:], observers[2][:1]
        title = f"{plan.name}: power of a paired t-test at 0.05, of {runs} simulated participants"
    texts = [json.dumps(one) for one in simulations(plan, *observers, runs, comparison)]
    with Here() if workers == 1 else Processes(workers) as executor:
        found = {text: future.result() for text, future in finished(executor, simulated, texts)}
    rows = [row for text in texts for row in json.loads(found[text])]
    shown = [
        {key: round(value, 3) if isinstance(value, float) else value for key, value in row.items()}
        for row in rows
    ]
    show(title, rows if as_json else shown, as_json)


@app.command()
def new(
    study: Annotated[Path, argument("Folder that is not there yet.", Folder)],
    as_json: AsJson = False,
) -> None:
    """Begin a study: code/experiment.toml to change, and the frame of a BIDS data set."""
    from haptix.stimuli.study import begin

    rows = [{"file": str(path)} for path in begin(study, study.absolute().name)]
    show(f"{study}: change code/experiment.toml, then simulate and run it", rows, as_json)


@app.command()
def bids(
    log: Annotated[Path, argument("Log of `haptix stimuli run`.", FileThere)],
    study: Annotated[Path, option("Folder of the data set.", Folder)],
    participant: Annotated[str, option("Pseudonym: letters and digits.", Label)],
    session: Annotated[str, option("Label of the session.", Label)] = "01",
    task: Annotated[str, option("Label of the task.", Label)] = "detection",
    as_json: AsJson = False,
) -> None:
    """Write a log into a study in the Brain Imaging Data Structure (BIDS).

    Behaviour of every attempt, the stimulus against time, and where the panel reports touches the
    finger's path and force; the log itself goes to sourcedata.
    """
    from haptix.stimuli.study import export

    files = export(log, study, participant, session, task)
    rows = [{"file": str(path)} for path in files]
    show(f"{len(rows)} files of sub-{participant} in {study}", rows, as_json)


@app.command()
def analyse(
    source: Annotated[
        Path, argument("Log of `haptix stimuli run`, folder of logs, or a study.", FileOrFolder)
    ],
    out: Annotated[
        Path | None,
        option(
            "Folder of tables and report. [default: derivatives/haptix of a study; of a log "
            "its name + _analysis]",
            Folder,
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Analyse sessions: thresholds of each participant and condition, and over participants.

    Thresholds are those of the method that ran, or none with the reason. Pairwise comparisons get a
    Bradley-Terry scale, magnitudes geometric means and their exponent. Writes tables (TSV) and
    report.html with a picture of each run.
    """
    from haptix.stimuli.analysis import analyse as analysed
    from haptix.stimuli.analysis import write_analysis

    found = analysed(source)
    is_study = (source / "dataset_description.json").exists()
    if out is None:
        place = source / "derivatives" / "haptix" if is_study else source / "analysis"
        out = place if source.is_dir() else source.with_name(f"{source.stem}_analysis")
    files = write_analysis(found, out, source.resolve().stem, is_study)
    if as_json:
        show("", [{**found.tables, "notes": list(found.notes)}], True)
        return
    for name, rows in found.tables.items():
        same = {key for key in _LABELS if len({row.get(key) for row in rows}) == 1}
        hidden = {*_WIDE, *same}
        shown = [{key: one for key, one in row.items() if key not in hidden} for row in rows]
        show(name, shown, False)
    show("; ".join((f"report: {files[-1]}", *found.notes)), [], False)


_LABELS = ("session", "task", "condition")
_WIDE = (
    "experiment", "share_right", "catch_trials", "hits", "false_alarms", "criterion", "warnings",
    "between", "p", "spread_within",
)  # fmt: skip
"""Columns that are in the files, and too many for a terminal."""


def _known(value: float) -> float | None:
    return None if isnan(value) else value
