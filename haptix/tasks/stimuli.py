"""Tasks of stimuli for perception experiments: make and draw sets, run and analyse trials."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, closing
from functools import partial
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator, Field

from haptix.base.errors import InputError
from haptix.base.fields import (
    Address,
    Argument,
    FileOrFolder,
    FileThere,
    Folder,
    FolderName,
    ForClients,
    JsonObject,
    Label,
    Local,
    NewFile,
    NewPicture,
    NotNegative,
    Positive,
    refuse_input,
)
from haptix.base.task import Context, Result, Task
from haptix.base.terminal import placeholder_note
from haptix.model.presets import FINGERS, SCREENS, FingerName, ScreenName, breakdown_note

if TYPE_CHECKING:
    from haptix.lab.experiment import Experiment, Question

_STAGES = {
    "surface": "build the friction surfaces",
    "render": "render and check",
    "write": "publish, draw the sheet",
}
_LABELS = ("session", "task", "condition", "source")
_WIDE = (
    "experiment", "share_right", "catch_trials", "hits", "false_alarms", "criterion", "warnings",
    "between", "p", "overdispersion", "drift_probability", "spread_logit",
)  # fmt: skip
"""Columns of the files that a terminal has no space for."""
_ASK_AFTER_H = 0.05  # three minutes: the next participant comes later


def _number_of(participant: str) -> int:
    """Return the number at the end of a pseudonym."""
    match = re.fullmatch(r"[A-Za-z0-9]*?([0-9]+)", participant)
    if match is None or len(participant) > 64 or not 1 <= int(match[1]) < 2**31:
        raise ValueError(
            "expected letters and digits with a number from 1 at the end, such as 07 or p07, got "
            f"{participant!r:.80}"
        )
    return int(match[1])


def _pseudonym(value: str) -> str:
    _number_of(value)
    return value


Pseudonym = Annotated[str, AfterValidator(_pseudonym)]
AtOnce = Annotated[int, Field(ge=1, le=256)]


class MakeSet(Task, command="stimuli make"):
    """Render a set: drive files with sidecars, trial table, contact sheet, manifest.

    Nothing is published unless all stimuli are within the limits and the reachable range. A run
    that was stopped continues where it ended.
    """

    recipe: Annotated[FileThere, Argument] = Field(description="Set of stimuli: a TOML file.")
    out: Folder | None = Field(None, description="Folder. [default: the set's name]")
    threads: AtOnce = Field(2, description="Threads; the bytes do not depend on it.")
    workers: AtOnce = Field(
        1,
        description="Processes that make files, for sets of hundreds; the bytes do not depend "
        "on it.",
    )

    def run(self, context: Context) -> Result:
        """Make it."""
        context.progress(_STAGES["surface"], 0.0)
        from haptix.base.files import file_name
        from haptix.lab.stimuli.recipe import Recipe
        from haptix.tasks.campaign.processes import Processes

        def update(stage: str, share: float) -> None:
            context.progress(_STAGES[stage], share)

        stimuli = Recipe.load(self.recipe).stimulus_set()
        folder = self.out or Path(file_name("name", stimuli.name))
        if self.workers == 1:
            result = stimuli.make(folder, self.threads, update)
        else:
            with Processes(self.workers) as executor:
                result = stimuli.make(folder, 1, update, executor)
        again = f", {result.reused} of them from an earlier run" if result.reused else ""
        title = f"{len(result.sidecars)} stimuli in {result.folder}{again}"
        past = max((table["pull_past_breakdown"] for table in result.sidecars), default=0.0)
        title += _placeholders(result.sidecars) + breakdown_note(past)
        title += _warnings(result.sidecars)
        return Result([*result.sidecars], [(title, [*map(_row, result.sidecars)])])


class MakeAgain(Task, command="stimuli again"):
    """Make a drive file again from its sidecar and profiles.json; every byte must be the same."""

    sidecar: Annotated[FileThere, Argument] = Field(
        description="Sidecar of a drive file (NAME.json)."
    )
    out: NewFile = Field(description="Drive file to write.")

    def run(self, context: Context) -> Result:
        """Make it."""
        from haptix.lab.stimuli.stimulus_set import make_again

        drive_file = make_again(self.sidecar, self.out)
        return Result([{"file": str(drive_file)}], lines=[f"{drive_file}: the same, byte for byte"])


class ShowStimulus(Task, command="stimuli show"):
    """Draw a stimulus (waveform, spectrum, friction, thresholds, audibility), or check a set."""

    what: Annotated[FileOrFolder, Argument] = Field(description="Drive file, or folder of a set.")
    out: NewPicture | None = Field(
        None, description="Picture of a drive file. [default: its name + .png]"
    )

    def run(self, context: Context) -> Result:
        """Check a set, or draw a stimulus."""
        from haptix.base.files import read_json, reading, write_whole

        path = self.what
        if path.is_dir():
            from haptix.lab.stimuli.stimulus_set import check_manifest, read_manifest

            wrong = check_manifest(path)
            if wrong:
                raise InputError(
                    f"{path}: {len(wrong)} files are missing or differ from the manifest: "
                    f"{', '.join(wrong[:5])}; make the set again"
                )
            manifest = read_manifest(path)
            place = path
            with reading(path / "manifest.json", "the manifest of a set"):
                title = f"{manifest['set']}: all files are whole; sheet: {path}/sheet.png"
                files = [name for name in manifest["files"] if name.endswith((".wav", ".flac"))]
            sidecars = [(path / name).with_suffix(".json") for name in files]
        else:
            from haptix.lab.stimuli.drawing import draw_stimulus

            sidecars = [place := path.with_suffix(".json")]
            picture = self.out or path.with_suffix(".png")
            refuse_input(picture, path, place)
            write_whole(picture, draw_stimulus(path))
            title = f"picture: {picture}"
        with reading(place, "stimuli with their sidecars"):
            tables = [read_json(path) for path in sidecars]
            past = max((float(table["pull_past_breakdown"]) for table in tables), default=0.0)
            title += _current([table["current"] for table in tables])
            title += _placeholders(tables) + breakdown_note(past) + _warnings(tables)
            return Result(tables, [(title, [*map(_row, tables)])])


class RunExperiment(Task, command="stimuli run"):
    """Run an adaptive experiment on a device; the task says which keys answer (1/2, l/r, y/n, s/d).

    Writes a log, or with --study into a study. The same command continues a session that was
    stopped, and replaces nothing of another one. With --simulate-db a simulated observer answers
    and nothing waits.
    """

    recipe: Annotated[FileThere, Argument] = Field(description="Experiment: a TOML file.")
    log: NewFile | None = Field(None, description="Table of the trials; continued if it exists.")
    study: Folder | None = Field(
        None, description="Folder of a study, which gets the log and its BIDS files."
    )
    device: Address = Field("mock:", description="Address of the device.")
    simulate_db: float | None = Field(
        None, description="Simulate an observer of this threshold [dB]."
    )
    participant: Pseudonym | None = Field(
        None,
        description="Pseudonym: letters and digits. The number at its end decides the order "
        "of blocks. [default, for a log: 1, and trials in the recipe's order]",
    )
    session: Label = Field(
        "01", description="Label of the session; with the participant's it seeds the random draws."
    )
    task: Label | None = Field(
        None, description="Label of the task in a study. [default: the recipe's name]"
    )
    ask_after_h: NotNegative = Field(
        _ASK_AFTER_H,
        description="Ask before a session continues whose last trial is longer ago [h].",
    )
    another_program: bool = Field(
        False, description="Continue a log that another version of haptix began."
    )
    lsl: bool = Field(
        False,
        description="Send drive, touches and markers to Lab Streaming Layer; waits for a recorder.",
    )

    def run(self, context: Context) -> Result:
        """Run it; the terminal gives single keys, so that no Enter is needed."""
        if (self.log is None) == (self.study is None):
            raise InputError("run: expected either --log FILE or --study FOLDER")
        if self.study is not None and self.participant is None:
            raise InputError("--participant: a study needs one, such as 07")
        who = self.participant or "1"
        from haptix.lab.experiment import TASKS, Keys, SimulatedObserver
        from haptix.lab.experiment.orders import seed_of
        from haptix.lab.experiment.recipe import ExperimentRecipe
        from haptix.play.devices import open_device

        plan = ExperimentRecipe.load(self.recipe)
        labels = who, self.session, self.task or re.sub("[^A-Za-z0-9]", "", plan.name)
        table = self.log
        seed = square_seed = None  # without a participant, trials are in the order of the recipe
        if self.participant is not None:
            seed = seed_of(plan.seed, who, self.session)
            group = who.rstrip("0123456789").casefold()  # shares squares, as its numbers do
            square_seed = seed_of(plan.seed, group, self.session)
        from haptix.lab.analysis.study import keep_recipe, session_log

        if self.study is not None:
            table = session_log(self.study, *labels)
        assert table is not None
        keep_recipe(self.recipe, table)
        keys = Keys()
        answer: Any = keys
        around: dict[str, Any] = {"rest": keys.rest, "tell": keys.tell, "show": keys.show}
        if self.simulate_db is not None:
            guess = TASKS[plan.task].guess or 0.05
            drawn = plan.seed if seed is None else seed
            answer = SimulatedObserver(self.simulate_db, guess=guess, seed=drawn)
            around = {"wait": lambda seconds: None}
        with ExitStack() as stack:
            device = stack.enter_context(closing(open_device(self.device)))
            if self.lsl:
                from haptix.play.render.lab_streams import LabOutlets

                outlets = stack.enter_context(closing(LabOutlets(device)))
                context.tell(step="waiting for a recorder of the streams haptix-*")
                outlets.wait_for_recorders()
                around["outlets"] = outlets
            around |= {"another_program": self.another_program, "participant": self.participant}
            seeds = _number_of(who), seed, square_seed
            experiment = plan.experiment(device, answer, table, *seeds, **around)
            for warning in experiment.contact_warnings:
                context.tell(step=f"warning: {warning}")
            was_over = experiment.is_over
            if self.simulate_db is None:
                ask_to_go_on(context, experiment, self.ask_after_h)
            try:
                experiment.run()
            finally:
                if self.study is not None and experiment.log.rows:
                    from haptix.lab.analysis.study import export

                    export(table, self.study, *labels)
        rows, warnings = [], []
        for name, record in experiment.records().items():
            warnings += [f"{name}: {line}" if name else line for line in record["warnings"]]
            rows.append({"condition": name, **record} if name else record)
        title = f"{plan.name}: trials in {table}"
        if was_over:
            title = f"{plan.name}: this session was finished before; its trials stay in {table}"
        title = "; warning: ".join((title, *warnings))
        shown = [{k: value for k, value in row.items() if k != "warnings"} for row in rows]
        return Result(rows, [(title, shown)])


class ExperimentJob(Task, route="experiments", kind="experiment", plays=True, keeps="logs"):
    """Run an adaptive experiment on the device; each trial asks."""

    recipe: Annotated[JsonObject, ForClients()] = Field(
        description="Like the file of `haptix stimuli run`, but without volts."
    )
    log: FolderName = Field(
        title="Name of the table of trials",
        description="Letters, digits, dashes. A table that exists is continued. It lies in the "
        "service's folder, experiments.",
    )
    participant: Annotated[int, Field(ge=1, le=10_000)] = Field(
        1,
        title="Number of the participant",
        description="It decides the order of a recipe's blocks, and with the table's name seeds "
        "the random draws.",
    )
    finger: Annotated[FingerName | None, Local()] = None
    screen: Annotated[ScreenName | None, Local()] = None
    device: Address = "mock:"

    def run(self, context: Context) -> Result:
        """Run it; a person answers each trial."""
        recipe = {**self.recipe}
        refuse_files_and_volts(recipe)
        for kind, presets in (("finger", FINGERS), ("screen", SCREENS)):
            used = getattr(self, kind)
            name = recipe.get(kind) or used or next(iter(presets))
            if name != used and name not in presets:
                words = ", ".join(presets)
                raise InputError(f"{kind}: expected {used} or one of {words}, got {name!r:.80}")
            recipe[kind] = name
        from haptix.base.units import with_numbers
        from haptix.lab.experiment.orders import seed_of
        from haptix.lab.experiment.recipe import ExperimentRecipe
        from haptix.play.devices import open_device

        plan, given = ExperimentRecipe(**with_numbers("recipe", recipe)), self.model_fields_set
        assert context.folder is not None
        context.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        with closing(open_device(self.device)) as device:
            experiment = plan.experiment(
                device,
                lambda question: judgement(context, question),
                context.folder / f"{self.log}.csv",
                self.participant,
                seed_of(plan.seed, str(self.participant), self.log),
                participant=str(self.participant) if "participant" in given else None,
                source="page",
                rest=partial(_rest, context),
                tell=lambda is_right: context.tell(step="right" if is_right else "wrong"),
            )
            ask_to_go_on(context, experiment)
            experiment.run()
        records = experiment.records()
        conditions = records if len(records) > 1 else next(iter(records.values()))
        return Result({"trials": experiment.trials, **conditions})


class Simulate(Task, command="stimuli simulate"):
    """Simulate a plan before the first session: how good its thresholds are, and its power.

    A row for observers of each threshold, slope and lapse rate: bias, scatter, width of the 95 %
    interval, how often it holds the truth, and how often there is no threshold or a warning. With
    --participants: how often the test of `haptix stimuli analyse` finds a difference between two
    conditions, for each slope and lapse rate.

    With --predict, for a set of stimuli instead of an experiment: the share of detections of each
    stimulus, by the virtual finger and the published thresholds, with the interval of 95 % of
    people; with --participants, how often a study of two alternatives tells each from guessing.
    """

    recipe: Annotated[FileThere, Argument] = Field(
        description="Experiment: a TOML file; with --predict, a set of stimuli."
    )
    predict: bool = Field(False, description="Predict who detects each stimulus of a set.")
    threshold_db: tuple[float, ...] | None = Field(
        None, description="Thresholds of the observers [dB], for an experiment."
    )
    slope: tuple[Positive, ...] = Field((1.5, 3.5), description="Slopes of the observers.")
    lapse: tuple[NotNegative, ...] = Field(
        (0.02, 0.08), description="Lapse rates of the observers."
    )
    runs: Annotated[int, Field(ge=10, le=100_000)] = Field(
        200, description="Runs of each observer."
    )
    participants: tuple[Annotated[int, Field(ge=2)], ...] | None = Field(
        None, description="Sample sizes whose power is asked for, such as 8,12,16."
    )
    difference_db: float = Field(2.0, description="Difference of two conditions [dB].")
    between_db: NotNegative = Field(3.0, description="Spread of thresholds between people [dB].")
    preregister: NewFile | None = Field(
        None,
        description="With --participants: write design, exclusions, test and power to this file, "
        "such as STUDY/code/preregistration.json; `analyse` compares the sessions with it.",
    )
    workers: AtOnce = Field(1, description="Processes that simulate.")

    def run(self, context: Context) -> Result:
        """Simulate."""
        if self.predict:
            return self._predicted(context)
        if self.threshold_db is None:
            raise InputError(
                "--threshold-db: an experiment needs the thresholds of its observers, such as 22,26"
            )
        from haptix.base.executors import Here
        from haptix.lab.analysis.power import SimulateObserver, simulations
        from haptix.lab.experiment.recipe import ExperimentRecipe
        from haptix.tasks.campaign.processes import Processes

        plan = ExperimentRecipe.load(self.recipe)
        observers = self.threshold_db, self.slope, self.lapse
        title, comparison = f"{plan.name}: {self.runs} runs of each observer", None
        if self.participants is not None:
            comparison = {
                "participants": [*self.participants],
                "difference": self.difference_db,
                "between": self.between_db,
            }
            observers = self.threshold_db[:1], self.slope, self.lapse
        elif self.preregister is not None:
            raise InputError("--preregister: expected --participants, the planned number of them")
        simulated = [*simulations(plan, *observers, self.runs, comparison)]
        if comparison is not None:
            least = simulated[0].expected_s() * ceil(len(simulated) / self.workers) / 60
            expected = f"expected: {least:.0f} to {4 * least:.0f} minutes, until powers are known"
            context.tell(step=f"{expected} within 0.02")
        with Here() if self.workers == 1 else Processes(self.workers) as executor:
            rows = [row for rows in executor.map(SimulateObserver.rows, simulated) for row in rows]
        if self.participants is not None:
            title = (
                f"{plan.name}: power of the test of `haptix stimuli analyse` at 0.05; assumed: "
                f"slopes {_list(self.slope)}, lapses {_list(self.lapse)}, thresholds that scatter "
                f"by {self.between_db:g} dB between people and by a third of it in each condition"
            )
            for count in self.participants:
                power = [row["power"] for row in rows if row["participants"] == count]
                title += f"; {count} participants: {min(power):.2f} to {max(power):.2f}"
            if self.preregister is not None:
                from haptix.lab.analysis.preregistration import Preregistration

                Preregistration.of(plan, max(self.participants), rows).save(self.preregister)
                title += f"; stated in {self.preregister}"
        return Result(rows, [(title, _rounded(rows))])

    def _predicted(self, context: Context) -> Result:
        if self.threshold_db is not None:
            raise InputError("--predict: thresholds are those of the set; leave --threshold-db out")
        from haptix.lab.analysis.power import People, predictions
        from haptix.lab.stimuli.recipe import Recipe

        plan = Recipe.load(self.recipe).stimulus_set()
        people = People(self.between_db, self.slope, self.lapse)
        counts = self.participants or ()
        rows = [*predictions(plan, people, counts, lambda s: context.progress("render", s))]
        title = (
            f"{plan.name}: detections predicted; assumed: thresholds scatter by "
            f"{self.between_db:g} dB between people, slopes {_list(self.slope)}, lapses "
            f"{_list(self.lapse)}"
        )
        if counts:
            title += f"; power: {plan.trials.repeats} answers each against guessing, at 0.05"
        title += (
            "\nsteady_db, edges_db: level above the published threshold; unknown_share: of the "
            "changes' energy, at frequencies without one; detected: by how many, of people from "
            "low to high; not known: where more than a tenth is unknown and the rest is not felt"
        )
        shown = [{name: row[name] for name in row if name != "is_reached"} for row in rows]
        return Result(rows, [(title, _rounded(shown))])


def _list(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _rounded(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    return [
        {
            name: "not known"
            if cell is None
            else round(cell, 3)
            if isinstance(cell, float)
            else cell
            for name, cell in row.items()
        }
        for row in rows
    ]


class NewStudy(Task, command="stimuli new"):
    """Begin a study: the frame of a BIDS data set, with code/experiment.toml to change."""

    study: Annotated[Folder, Argument] = Field(description="Folder that does not exist yet.")

    def run(self, context: Context) -> Result:
        """Write it."""
        from haptix.lab.analysis.study import begin

        rows = [{"file": str(path)} for path in begin(self.study, self.study.absolute().name)]
        title = f"{self.study}: change code/experiment.toml, then simulate and run it"
        return Result(rows, [(title, rows)])


class ExportBids(Task, command="stimuli bids"):
    """Write a log into a study in the Brain Imaging Data Structure (BIDS).

    It writes the behaviour of every attempt, the stimulus against time and, if the panel reports
    touches, the finger's path and force. The log itself goes to sourcedata.
    """

    log: Annotated[FileThere, Argument] = Field(description="Log of `haptix stimuli run`.")
    study: Folder = Field(description="Folder of the data set.")
    participant: Label = Field(description="Pseudonym: letters and digits.")
    session: Label = Field("01", description="Label of the session.")
    task: Label = Field("detection", description="Label of the task.")
    recipe: FileThere | None = Field(
        None, description="Recipe of the log. [default: LOG_experiment.toml beside the log]"
    )

    def run(self, context: Context) -> Result:
        """Write it."""
        from haptix.lab.analysis.study import export

        labels = self.participant, self.session, self.task
        files = export(self.log, self.study, *labels, self.recipe)
        rows = [{"file": str(path)} for path in files]
        return Result(
            rows, [(f"{len(rows)} files of sub-{self.participant} in {self.study}", rows)]
        )


class Analyse(Task, command="stimuli analyse"):
    """Analyse sessions: thresholds of each participant and condition, and over participants.

    Thresholds are those of the method that ran; if there is none, the reason is given. Pairwise
    comparisons get a Bradley-Terry scale, magnitudes geometric means and their exponent. Writes
    tables (TSV) and report.html with a picture of each run.
    """

    source: Annotated[FileOrFolder, Argument] = Field(
        description="Log of `haptix stimuli run`, folder of logs, or a study; with --columns, a "
        "table of trials of another program, or a folder of tables."
    )
    columns: FileThere | None = Field(
        None, description="Which column of another program's table is what, as TOML."
    )
    out: Folder | None = Field(
        None,
        description="Folder of tables and report. [default: derivatives/haptix of a study; "
        "of a log its name + _analysis]",
    )
    preregistration: FileThere | None = Field(
        None,
        description="What was stated before the data. [default: code/preregistration.json of a "
        "study]",
    )

    def run(self, context: Context) -> Result:
        """Analyse, and write tables and report."""
        from haptix.lab.analysis.foreign import TrialColumns
        from haptix.lab.analysis.results import TRIALS, analyse, write_analysis

        columns = None if self.columns is None else TrialColumns.load(self.columns)
        source = self.source
        analysis = analyse(source, self.preregistration, columns)
        is_study = (source / "dataset_description.json").exists()
        beside = source / "derivatives" / "haptix" if is_study else source / "analysis"
        if not source.is_dir():
            beside = source.with_name(f"{source.stem}_analysis")
        files = write_analysis(analysis, self.out or beside, source.resolve().stem, is_study)
        tables = []
        for name, rows in analysis.tables.items():
            if name == TRIALS:
                continue
            same = {key for key in _LABELS if len({row.get(key) for row in rows}) == 1}
            hidden = {*_WIDE, *same}
            shown = [{k: cell for k, cell in row.items() if k not in hidden} for row in rows]
            tables.append((name, shown))
        report_line = "; ".join((f"report: {files[-1]}", *analysis.notes))
        return Result([{**analysis.tables, "notes": [*analysis.notes]}], tables, [report_line])


def judgement(context: Context, question: Question) -> str:
    """Ask for one of the choices; without choices, ask until a number comes that can be."""
    if question.choices:
        return context.ask(question.asks, question.choices)
    while question.objection(number := context.ask(question.asks)):
        pass
    return number


def ask_to_go_on(context: Context, experiment: Experiment, after_h: float = _ASK_AFTER_H) -> None:
    """Ask whether to continue a session whose last trial was long ago.

    Raises `InputError` if the answer is no.
    """
    rested_h = experiment.rested_s / 3600
    if rested_h <= after_h:
        return
    experiment.log.close()  # until the answer comes
    rested = f"{rested_h:.0f} hours" if rested_h > 1.5 else f"{60 * rested_h:.0f} minutes"
    name = experiment.log.path.name
    question = f"The last trial of {name} was {rested} ago. Does the same person go on?"
    if context.ask(question, ("no", "yes")) != "yes":
        raise InputError(
            f"{experiment.log.path}: stays as it is; name another log, participant or session"
        )


def _rest(context: Context, trials: int) -> None:
    context.ask(f"Rest a moment: {trials} trials are done.", ("continue",))


def refuse_files_and_volts(recipe: Mapping[str, Any]) -> None:
    """Refuse files and volts in a recipe that a client of the network sends."""
    if isinstance(recipe.get("items"), str):
        raise InputError("recipe: items: expected a list; a set is a file")
    if "folder" in recipe or recipe.get("ceiling_v") is not None:
        raise InputError("recipe: expected no folder and no ceiling_v: no volts come in")
    names = ("stimulus", "pedestal", "method", "conditions", "items")
    values = [recipe.get(name) for name in names]
    while values:
        value = values.pop()
        if isinstance(value, dict):
            values += value.values()
        elif isinstance(value, list):
            values += value
        elif isinstance(value, str) and (value == "volts" or set(value) & set("./\\")):
            raise InputError(f"recipe: expected neither volts nor files, got {value!r:.40}")


def _current(currents: Sequence[Mapping[str, float]]) -> str:
    """Return the largest expected current and its limits, in words."""
    if not currents:
        return ""
    peak, rms = (
        f"{max(current[f'expected_{kind}_a'] for current in currents) * 1e3:.2g} mA "
        f"(limit {currents[0][f'limit_{kind}_a'] * 1e3:g})"
        for kind in ("peak", "rms")
    )
    return f"; current at most {peak}, {rms} rms"


def _warnings(sidecars: Sequence[Mapping[str, Any]]) -> str:
    """Return what of the contacts is beyond what was measured, in words."""
    named = dict.fromkeys(line for sidecar in sidecars for line in sidecar.get("warnings", ()))
    return "".join(f"; warning: {line}" for line in named)


def _placeholders(sidecars: Sequence[Mapping[str, Any]]) -> str:
    return placeholder_note(
        sorted({name for sidecar in sidecars for name in sidecar["placeholders"]})
    )


def _level(felt: Mapping[str, Any] | None, name: str) -> str:
    """Return a level, with a star if it rests on unmeasured values."""
    level = None if felt is None else felt.get(name)
    star = "*" if felt and felt["threshold_is_placeholder"] else ""
    return "-" if level is None else f"{level:+.1f}{star}"


def _row(sidecar: Mapping[str, Any]) -> dict[str, Any]:
    prediction, felt = sidecar["predicted"], sidecar["felt"]
    return {
        "file": sidecar["file"],
        "s": f"{sidecar['length_s']:.3g}",
        "peak V": f"{sidecar['peak_v']:.1f}",
        "mu": f"{prediction['mu_low']:.3f}-{prediction['mu_high']:.3f}",
        "dB SL": _level(felt, "sensation_db"),
        "edges dB": _level(felt, "edges_db"),
        "past %": f"{100 * sidecar['pull_past_breakdown']:.0f}",
        "audible": "yes" if sidecar["audibility"]["audible"] else "no",
    }  # fmt: skip
