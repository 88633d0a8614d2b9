"""Whether the tests notice a safety line of the Pico's port that is wrong: each must fail.

``python -m tests.devices.pico_mutants`` changes one text at a time in a copy of the sources, builds
the board's firmware, runs `test_pico_board.py` on it and reports the mutants that survive; some
minutes each. ``-k TEXT`` takes those whose text has it. A mutant that
waits for ever has been noticed.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
BOARD = Path("examples", "boards", "pico")
#: Of the tests of one mutant: they take 160 s on a quiet machine.
MOST_S = 800
_TABLE = tomllib.loads(Path(__file__).with_suffix(".toml").read_text())


class Mutant(NamedTuple):
    """A text of one file of the board, and what takes its place."""

    file: str
    text: str
    change: str


MUTANTS = [Mutant(*fields) for fields in _TABLE["mutants"]]


def survives(mutant: Mutant) -> bool:
    """Whether the board's tests pass with a mutant."""
    with TemporaryDirectory() as folder:
        listed = subprocess.run(
            ["git", "ls-files", "-co", "--exclude-standard"],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=True,
        )
        for name in listed.stdout.splitlines():
            to = Path(folder, name)
            to.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, to)
        modules = Path("tests", "firmware_io", "pico", "node_modules")
        Path(folder, modules).symlink_to(ROOT / modules)
        path = Path(folder, BOARD, mutant.file)
        source = path.read_text()
        assert not mutant.text or source.count(mutant.text) == 1, mutant
        path.write_text(source.replace(mutant.text, mutant.change))
        flags = path.with_name("flags.txt")  # a mutant may leave a function unused
        flags.write_text(flags.read_text().replace("-Werror", ""))
        words = ["-x", "-q", "-m", "devices", "-p", "no:cacheprovider"]
        words += ["-k", "not (list_of_mutants or a_minute)", "tests/devices/test_pico_board.py"]
        command = [sys.executable, "-m", "pytest", *words]
        try:
            done = subprocess.run(
                command,
                cwd=folder,
                env={**os.environ, "PYTHONPATH": folder, "HAPTIX_NO_SKIPS": "1"},
                capture_output=True,
                text=True,
                check=False,
                timeout=MOST_S,
            )
        except subprocess.TimeoutExpired:
            return False
        if "CalledProcessError" in done.stdout or "BuildError" in done.stdout:
            raise SystemExit(f"{mutant} does not compile: {done.stdout[-2000:]}")
        return done.returncode == 0


def main() -> int:
    """Report the mutants that survive; return how many do."""
    parser = argparse.ArgumentParser()
    parser.add_argument("-k", default="")
    wanted = parser.parse_args().k
    assert survives(Mutant("main.c", "", "")), "the tests fail without a mutant"
    left = 0
    for mutant in MUTANTS:
        if wanted in mutant.text:
            alive = survives(mutant)
            left += alive
            sys.stdout.write(f"{'survives' if alive else 'killed'}: {mutant}\n")
            sys.stdout.flush()
    return left


if __name__ == "__main__":
    sys.exit(main())
