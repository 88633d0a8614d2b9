"""The command line called in this process."""

import contextlib
import io
import re
import sys
from dataclasses import dataclass
from typing import Protocol

import pytest

from haptix.tasks.cli import main

_PROGRESS = re.compile(r"^haptix: [^\n]*: \d+%(?:, \d+ s left)?\n", re.MULTILINE)


@dataclass(frozen=True)
class CommandResult:
    """What a command printed, and its exit code.

    Without the lines of progress, of which a slow machine prints some and a fast one none.
    """

    code: int
    out: str
    err: str


class CommandLine(Protocol):
    """``haptix ARGUMENTS``, called with the arguments."""

    def __call__(self, *arguments: object, stdin: str | None = None) -> CommandResult: ...


def run_haptix(*arguments: object, stdin: str | None = None) -> CommandResult:
    """Run ``haptix ARGUMENTS``; an exception that leaves main is a traceback for the user."""
    out, err = io.StringIO(), io.StringIO()
    code = 0
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        patch.setattr(sys, "argv", ["haptix", *map(str, arguments)])
        if stdin is not None:
            patch.setattr(sys, "stdin", io.StringIO(stdin))
        try:
            main()
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
    return CommandResult(code, out.getvalue(), _PROGRESS.sub("", err.getvalue()))
