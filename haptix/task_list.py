"""Which tasks there are, read from the text of their modules: a list of them loads nothing."""

from __future__ import annotations

import re
from collections.abc import Sequence
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
]
"""Modules of tasks, in the order in which help lists them."""

_TASK = re.compile(
    r'^class (\w+)\([^)]*?command="([\w -]+)"[^)]*\):\n    """([^\n]*?)("""|\n)', re.MULTILINE
)


def tasks_of(modules: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return by the words of each task's command its ``module:Class`` and its first sentence."""
    tasks = {}
    for module in modules:
        text = _file_of(module).read_text(encoding="utf-8")
        for name, command, sentence, _ in _TASK.findall(text):
            tasks[command] = (f"{module}:{name}", sentence)
    return tasks


def commands() -> dict[str, tuple[str, str]]:
    """Return by the first word of each task's command what it is, and its sentence.

    A task is ``module:Class``. Tasks of one module whose commands share their first word, such as
    ``material show``, are a group: the word with the first sentence of the module.
    """
    first_words: dict[str, tuple[str, str]] = {}
    for command, (path, sentence) in tasks_of(MODULES).items():
        word, _, rest = command.partition(" ")
        if rest:
            text = _file_of(path.partition(":")[0]).read_text(encoding="utf-8")
            path, sentence = "", text.partition('"""')[2].partition('"""')[0].partition("\n")[0]
        first_words.setdefault(word, (path, sentence))
    return first_words


def _file_of(module: str) -> Path:
    """Return the file of a module, without importing it or its packages."""
    import sys

    inside = Path(*module.split(".")).with_suffix(".py")
    roots = [Path(__file__).parents[1], *map(Path, sys.path)]
    return next(root / inside for root in roots if (root / inside).is_file())
