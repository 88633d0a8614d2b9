"""Jobs as a worker does them: it says how far it is, asks, and returns the result."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from haptix.desk import Context, Task, all_tasks
from haptix.errors import InputError
from haptix.fields import FINGERS, SCREENS
from haptix.files import write_folder


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
            if name in task.model_fields and (used := self._name(name, fields.get(name))):
                fields[name] = used
        if task.plays:
            fields["device"] = self._context["device"]
        context = _JobContext(self._say, self._answers, task)
        if task.keeps:
            context.folder = Path(self._context[task.keeps])
        with in_folder(Path(self._context.get("assets", "")), is_sealed=True):
            result = task(**fields).run(context)
        if result.files:
            write_folder(Path(self._context["results"]), result.files)
        document = result.document
        return document if isinstance(document, dict) else {"rows": document}

    def _name(self, kind: str, name: str | None) -> str | None:
        """Return a preset or what is in use: a client names no files."""
        used: str | None = self._context.get(kind)
        presets = FINGERS if kind == "finger" else SCREENS
        if name is None or name == used:
            return used
        if name not in presets:
            raise InputError(f"{kind}: expected {used} or one of {', '.join(presets)}, got {name}")
        return name


class _JobContext(Context):
    """Tells the service how far a task is, and asks a person there."""

    def __init__(self, say: Callable[..., None], answers: Iterator[str], task: type[Task]) -> None:
        super().__init__()
        self.tell, self._answers = say, answers  # type: ignore[method-assign]
        self._stages = task.stages

    def progress(self, stage: str, share: float) -> None:
        super().progress(stage, share)
        if stage in self._stages:
            self.tell(share=(self._stages.index(stage) + share) / len(self._stages))

    def ask(self, prompt: str, choices: Sequence[str] = ()) -> str:
        self.tell(prompt=prompt, choices=tuple(choices))
        answer = next(self._answers, None)
        if answer is None:
            raise SystemExit(1)
        return answer
