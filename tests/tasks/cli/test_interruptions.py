"""Help by any name, completion, outputs that take no more, Ctrl-C."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import haptix
from haptix.base import terminal
from haptix.base.terminal import ProgressBar

ROOT = Path(haptix.__file__).parents[1]


def run(*arguments, **options):
    return subprocess.run(
        [sys.executable, "-m", "haptix.tasks.cli", *arguments], stderr=subprocess.PIPE, text=True,
        cwd=ROOT, check=False, **options,
    )  # fmt: skip


def test_help_has_its_usual_names(haptix_cli):
    assert haptix_cli("-h").out == haptix_cli("help").out == haptix_cli("--help").out
    for command in (["query"], ["material", "show"]):
        asked = haptix_cli("help", *command)
        assert asked.out == haptix_cli(*command, "-h").out == haptix_cli(*command, "--help").out
        assert asked.code == 0


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_there_is_a_script_that_completes(haptix_cli, shell):
    script = haptix_cli("completion", shell)
    assert script.code == 0
    assert "_HAPTIX_COMPLETE" in script.out


def test_a_shell_that_completes_gets_the_options():
    asked = {"COMP_WORDS": "haptix query --f", "COMP_CWORD": "2"}
    code = "import sys; from haptix.tasks.cli import main; sys.argv = ['haptix']; main()"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False,
        env=os.environ | asked | {"_HAPTIX_COMPLETE": "complete_bash"},
    )  # fmt: skip
    assert done.stdout.split() == ["--finger", "--fidelity", "--frequency-hz"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs Linux's /dev/full")
@pytest.mark.parametrize("command", [["--help"], ["cache"], ["cache", "--json"]])
def test_a_full_output_is_one_sentence(command):
    with Path("/dev/full").open("w") as full:
        done = run(*command, stdout=full)
    assert done.stderr == "haptix: the output takes no more: No space left on device\n"
    assert done.returncode == 2


@pytest.mark.skipif(sys.platform == "win32", reason="needs pipes as POSIX has them")
@pytest.mark.parametrize("command", [["--help"], ["cache"]])
def test_a_closed_pipe_is_no_traceback(command):
    reading, writing = os.pipe()
    os.close(reading)
    done = run(*command, stdout=writing)
    os.close(writing)
    assert done.stderr == ""
    assert done.returncode != 0


@pytest.mark.parametrize(
    "where",
    ["lazy_loader.attach_stub", "haptix.base.task_list.commands", "haptix.base.terminal.run"],
)
def test_ctrl_c_is_no_traceback_from_the_first_command_on(where):
    module, _, name = where.rpartition(".")
    code = (
        f"import sys; sys.argv = ['/bin/haptix', 'query']\n"
        f"import {module}\n"
        f"def interrupted(*_): raise KeyboardInterrupt\n"
        f"{module}.{name} = interrupted\n"
        "from haptix.tasks.cli import main; main()"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("", "")
    assert done.returncode in (130, -signal.SIGINT)


def test_ctrl_c_in_another_program_that_uses_haptix_has_its_traceback():
    command = [sys.executable, "-c", "import haptix; raise KeyboardInterrupt"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert "Traceback" in done.stderr


def test_the_headings_of_query_take_two_lines(haptix_cli, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    out = haptix_cli(
        "query", "--normal-force-n", 0.5, "--voltage-v", "0,100", "--frequency-hz", 4e3
    ).out
    table = out[: out.index("───")].splitlines()
    blank = max(i for i, line in enumerate(table) if not line.strip() and i < len(table) - 2)
    assert len([line for line in table[blank:] if line.strip()]) <= 2
    assert max(map(len, out.splitlines())) <= 80


def test_without_a_terminal_progress_is_a_line_now_and_then(monkeypatch, capsys):
    now_s = iter([0.0, 0.0, 0.0, 6.0, 12.0, 13.0])
    monkeypatch.setattr(terminal, "monotonic", lambda: next(now_s))
    with ProgressBar() as update:
        for share in (0.0, 0.25, 0.5, 0.75):
            update("build the surface", share)
    assert capsys.readouterr().err == "haptix: build the surface: 50%, 12 s left\n"


def test_an_error_of_a_library_is_not_taken_for_the_outputs(haptix_cli, monkeypatch):
    def fails(*_):
        raise OSError("could not get source code")  # no number, and no file

    monkeypatch.setattr("haptix.base.terminal.run", fails)
    with pytest.raises(OSError, match="source code"):
        haptix_cli("doctor")
