"""The list of all tasks, read from the text of their modules, so that it loads nothing."""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

_FIRST = ["strokes", "surfaces", "materials"]  # what a newcomer looks for in the help


def _modules() -> list[str]:
    """Return the modules of tasks: those of `haptix.tasks`, and those of calibration by name."""
    ours = [path.stem for path in _folder("haptix.tasks").glob("[!_]*.py")]
    ours.sort(key=lambda name: (_FIRST.index(name) if name in _FIRST else len(_FIRST), name))
    measuring = sorted(path.stem for path in _folder("calibration").glob("*tasks.py"))
    measuring.sort(key=len)  # `tasks` itself first
    return [f"haptix.tasks.{name}" for name in ours] + [f"calibration.{name}" for name in measuring]


def _folder(package: str) -> Path:
    """Return the folder of a package, this distribution's first, without importing it."""
    folder = Path(__file__).parents[2].joinpath(*package.split("."))
    if not folder.is_dir():
        spec = find_spec(package)
        assert spec is not None and spec.origin is not None
        folder = Path(spec.origin).parent
    return folder


MODULES = _modules()
"""Modules of tasks, in the order in which help lists them."""

_TASK = re.compile(
    r'^class (\w+)\([^)]*?command="([\w -]+)"[^)]*\):\n    """([^\n]*?)("""|\n)', re.MULTILINE
)


def tasks_of(modules: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return ``module:Class`` and first sentence of each task, by the words of its command."""
    return {
        command: (f"{module}:{name}", sentence)
        for module in modules
        for name, command, sentence, _ in _TASK.findall(_text(module))
    }


def commands() -> dict[str, tuple[str, str]]:
    """Return each task or group and its sentence, by the first word of its command.

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
    """Return the text of a module without importing it."""
    package, _, name = module.rpartition(".")
    if package:
        return (_folder(package) / f"{name}.py").read_text(encoding="utf-8")
    spec = find_spec(name)
    assert spec is not None and spec.origin is not None
    return Path(spec.origin).read_text(encoding="utf-8")
