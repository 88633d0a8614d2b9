"""Which tasks there are, read from the text of their modules: a list of them loads nothing."""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

MODULES = [
    "haptix.tasks.rendering",
    "haptix.tasks.surfaces",
    "haptix.tasks.scenes",
    "haptix.tasks.materials",
    "haptix.tasks.campaigns",
    "haptix.tasks.stimuli",
    "calibration.tasks",
    "calibration.result_tasks",
    "calibration.keeping_tasks",
]
"""Modules of tasks, in the order in which help lists them."""

_TASK = re.compile(
    r'^class (\w+)\([^)]*?command="([\w -]+)"[^)]*\):\n    """([^\n]*?)("""|\n)', re.MULTILINE
)


def tasks_of(modules: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return by the words of each task's command its ``module:Class`` and its first sentence."""
    return {
        command: (f"{module}:{name}", sentence)
        for module in modules
        for name, command, sentence, _ in _TASK.findall(_text(module))
    }


def commands() -> dict[str, tuple[str, str]]:
    """Return by the first word of each task's command what it is, and its sentence.

    A task is ``module:Class``. Tasks of one module whose commands share their first word, such as
    ``material show``, are a group: the word with the first sentence of the module.
    """
    first_words: dict[str, tuple[str, str]] = {}
    for command, (path, sentence) in tasks_of(MODULES).items():
        word, _, rest = command.partition(" ")
        if rest:
            path, sentence = "", _text(path.partition(":")[0]).split("\n")[0].strip('"')
        first_words.setdefault(word, (path, sentence))
    return first_words


def _text(module: str) -> str:
    """Return the text of a module, of this distribution first, without importing it."""
    path = Path(__file__).parents[1].joinpath(*module.split(".")).with_suffix(".py")
    if not path.exists():
        spec = find_spec(module)
        assert spec is not None and spec.origin is not None
        path = Path(spec.origin)
    return path.read_text(encoding="utf-8")
