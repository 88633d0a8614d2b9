"""Jobs as a worker does them: it says how far it is, asks, and returns the result."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from functools import partial
from math import inf, isfinite
from pathlib import Path
from typing import Any

from haptix.desk import Context, Task, all_tasks
from haptix.errors import InputError


class JobWork:
    """One job, by the names of its kinds.

    Parameters
    ----------
    context : dict
        Folder of assets and of logs, address of the device, finger and screen in use.
    say : callable
        Takes fields of a message to the service.
    answers : iterator of str
        What a person answers.
    """

    def __init__(
        self,
        context: dict[str, Any],
        say: Callable[..., None],
        answers: Iterator[str],
    ) -> None:
        self._context, self._say, self._answers = context, say, answers

    def __getattr__(self, kind: str) -> Callable[..., dict[str, Any]]:
        """Jobs that are tasks of the desk, by their kinds."""
        task = next((task for task in all_tasks() if task.route and task.kind == kind), None)
        if task is None:
            raise AttributeError(kind)
        return partial(self._do, task)

    def _do(self, task: type[Task], **fields: Any) -> dict[str, Any]:
        from haptix.kinds import in_folder  # with torch

        for name in ("finger", "screen"):
            if name in task.model_fields:
                fields[name] = self._name(name, fields.get(name))
        with in_folder(Path(self._context["assets"]), is_sealed=True):
            document: dict[str, Any] = task(**fields).run(_JobContext(self._say, task)).document
        return document

    def experiment(self, recipe: dict[str, Any], log: str, participant: int = 1) -> dict[str, Any]:
        """Run an adaptive experiment; a person answers each trial."""
        _refuse_files_and_volts(recipe)
        from haptix.devices import open_device
        from haptix.stimuli.adaptive import Experiment
        from haptix.stimuli.recipe import ExperimentRecipe
        from haptix.units import with_numbers

        names = {kind: self._name(kind, recipe.get(kind)) for kind in ("finger", "screen")}
        plan = ExperimentRecipe(**with_numbers("recipe", {**recipe, **names}))
        folder = Path(self._context["logs"])
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        with closing(open_device(self._context["device"])) as device:
            experiment = Experiment(
                plan.make_method(participant),
                plan.presentations(device.capabilities.sample_rate_hz),
                device,
                lambda question: self._judged(question.choices),
                folder / f"{log}.csv",
                plan.task,
                plan.seed,
                None,
                plan.pause_s,
                plan=plan.session_plan(),
                rest=self._rest,
                tell=lambda is_right: self._say(step="right" if is_right else "wrong"),
            )
            experiment.run()
        estimates = {}
        for name, estimate in experiment.estimates().items():
            row = {
                "threshold_db": estimate.threshold,
                "spread_db": estimate.spread,
                **estimate.others,
            }
            known = {key: value if isfinite(value) else None for key, value in row.items()}
            estimates[name] = {**known, "warnings": list(estimate.warnings)}
        first = estimates if len(estimates) > 1 else next(iter(estimates.values()))
        return {"trials": experiment.trials, **experiment.summary(), **first}

    def calibration(self, name: str, minutes: float) -> dict[str, Any]:
        """Continue the calibration that was planned under a name, or begin a practice."""
        from haptix.service.calibration_job import begin_practice, calibrate

        folder = Path(self._context["calibrations"]) / name
        if not (folder / "session.json").exists():
            begin_practice(folder, self._context["finger"], self._context["screen"], minutes)
        return calibrate(folder, self._context["device"], self._ask, self._say)

    def _ask(self, prompt: str, choices: tuple[str, ...]) -> str:
        self._say(prompt=prompt, choices=choices)
        answer = next(self._answers, None)
        if answer is None:
            raise SystemExit(1)
        return answer

    def _judged(self, choices: tuple[str, ...]) -> str:
        """Ask for one of the choices, or for a number above 0 until one comes."""
        if choices:
            return self._ask("Which one?", choices)
        while True:
            answer = self._ask("How strong was it? Give a number above 0.", ())
            with suppress(ValueError):
                if 0 < float(answer) < inf:
                    return answer

    def _rest(self, trials: int) -> None:
        self._ask(f"Rest a moment: {trials} trials are done.", ("continue",))

    def _name(self, kind: str, name: str | None) -> str:
        """Return a preset or what is in use: a client names no files."""
        from haptix.finger import Finger
        from haptix.screen import Screen

        used: str = self._context[kind]
        presets = (Finger if kind == "finger" else Screen).presets
        if name is None or name == used:
            return used
        if name not in presets:
            raise InputError(f"{kind}: expected {used} or one of {', '.join(presets)}, got {name}")
        return name


class _JobContext(Context):
    """Tells the service how far a task is; results are told, not written."""

    def __init__(self, say: Callable[..., None], task: type[Task]) -> None:
        super().__init__()
        self.tell, self._stages = say, task.stages  # type: ignore[method-assign]

    def progress(self, stage: str, share: float) -> None:
        super().progress(stage, share)
        if stage in self._stages:
            self.tell(share=(self._stages.index(stage) + share) / len(self._stages))


def _refuse_files_and_volts(recipe: dict[str, Any]) -> None:
    """Refuse what a client of the network may not say."""
    if "folder" in recipe or recipe.get("ceiling_v") is not None:
        raise InputError("recipe: expected no folder and no ceiling_v: no volts come in")
    tables = [recipe.get(name) for name in ("stimulus", "pedestal", "method", "conditions")]
    while tables:
        item = tables.pop()
        if isinstance(item, dict):
            tables += item.values()
        elif isinstance(item, list):
            tables += item
        elif isinstance(item, str) and (item == "volts" or set(item) & set("./\\")):
            raise InputError(f"recipe: expected neither volts nor files, got {item!r:.40}")
