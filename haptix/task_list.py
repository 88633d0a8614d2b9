"""Which tasks there are, read from the text of their modules: a list of them loads nothing."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

MODULES = ["haptix.tasks.rendering", "haptix.tasks.surfaces"]
"""Modules of tasks, in the order in which help lists them."""

_TASK = re.compile(
    r'^class (\w+)\([^)]*?command="([\w -]+)"[^)]*\):\n    """([^\n]*?)("""|\n)', re.MULTILINE
)


def tasks_of(modules: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return by the words of each task's command its ``module:Class`` and its first sentence."""
    found = {}
    for module in modules:
        text = _file_of(module).read_text(encoding="utf-8")
        for name, command, sentence, _ in _TASK.findall(text):
            found[command] = (f"{module}:{name}", sentence)
    return found


def _file_of(module: str) -> Path:
    """Return the file of a module, without importing it or its packages."""
    import sys

    inside = Path(*module.split(".")).with_suffix(".py")
    roots = [Path(__file__).parents[1], *map(Path, sys.path)]
    return next(root / inside for root in roots if (root / inside).is_file())
