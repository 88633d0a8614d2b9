"""The command line: which commands there are, and help that loads nothing."""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
import textwrap

from haptix.base.task_list import commands
from haptix.base.version import __version__, foreign_package

ABOUT = "Haptic rendering for electrovibration touchscreens: from contact mechanics to volts."

LOG_HELP = "Log to the standard error what happens, see docs/log.md: info or debug."


# Where each command stands, and the first sentence of its help: those that are tasks say both
# themselves. To load Typer takes longer than everything else that --help does.
COMMANDS = {
    **commands(),
    "serve": (
        "haptix.tasks.cli.service:serve",
        "Serve apps in any language on this machine: touches and materials in, friction out.",
    ),
    "studio": (
        "haptix.tasks.cli.service:studio",
        "Open the studio in a browser: feel textures by mouse, pen or touch, make and test them.",
    ),
    "completion": (
        "haptix.tasks.cli.application:completion",
        'Print the script that completes commands in a shell: eval "$(haptix completion bash)".',
    ),
    "devices": (
        "haptix.tasks.cli.hardware:devices",
        "List what can be opened, and what the buses show; and the touchscreens of this machine.",
    ),
    "firmware": (
        "haptix.tasks.cli.hardware:firmware",
        "Write the firmware of a board, as a file that its USB drive takes.",
    ),
    "doctor": (
        "haptix.tasks.cli.hardware:doctor",
        "Check this machine: packages, a known solve, drivers, audio, permissions, clocks.",
    ),
}


def main() -> None:
    """Run the command line; neither Ctrl-C nor an output that takes no more is a traceback."""
    if sys.argv[1:2] == ["help"]:  # haptix help query
        sys.argv[1:] = [*sys.argv[2:], "--help"]
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:  # closed, as by `>&-`: no file may get its number
            setattr(sys, name, open(os.devnull, "r+"))  # noqa: PTH123, SIM115
    try:
        match sys.argv[1:]:
            case ["--help" | "-h"]:
                sys.stdout.write(help_text())
            case ["--version"]:
                sys.stdout.write(f"haptix {__version__}\n")
            case _:
                if advice := foreign_package("firmware_io"):
                    sys.stderr.write(f"haptix: {advice}\n")
                    sys.exit(2)
                from haptix.base.terminal import run
                from haptix.tasks.cli.application import app

                run(app, "haptix")
        sys.stdout.flush()
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:  # such as by head
        _let_go_of_the_output()
        sys.exit(141)
    except OSError as error:
        where = error.filename
        if where is None and error.errno is None:  # a library's own, with a sentence alone
            raise
        if where is None:
            _let_go_of_the_output()
            where = "the output takes no more"
        sys.stderr.write(f"haptix: {where}: {error.strerror}\n")
        sys.exit(2)


def _let_go_of_the_output() -> None:
    """Python flushes the rest at the end, and would fail once more."""
    with contextlib.suppress(OSError, ValueError):  # a test's output has no number
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def help_text() -> str:
    """Return the help of the command line, line for line as Typer would write it."""
    width = max(min(shutil.get_terminal_size().columns, 80) - 2, 50)
    is_module = sys.argv[0].endswith("__main__.py")
    name = "python -m haptix.tasks.cli" if is_module else os.path.basename(sys.argv[0])  # noqa: PTH119
    options = {
        "--version": "Print the version.",
        "--log LEVEL": LOG_HELP,
        "-h, --help": "Show this message and exit.",
    }
    commands = {name: about for name, (_, about) in COMMANDS.items()}
    lines = [f"Usage: {name} [OPTIONS] COMMAND [ARGS]...", ""]
    lines += textwrap.wrap(ABOUT, width, initial_indent="  ", subsequent_indent="  ")
    for title, rows in (("Options", options), ("Commands", commands)):
        lines += ["", f"{title}:"]
        column = max(map(len, rows)) + 4
        for word, about in rows.items():
            first, *more = textwrap.wrap(about, width - column)
            lines += [f"  {word:{column - 2}}{first}", *(" " * column + line for line in more)]
    return "\n".join(lines) + "\n"
