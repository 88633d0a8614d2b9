"""Whether the checks notice a safety line that is wrong: each mutant of the firmware must fail.

``python mutants.py`` (or ``make mutants``) changes one line at a time in a copy of the core, by
mutants.toml, runs ``make check`` on it, two at a time, and reports the mutants that survive. It
needs no more than a C compiler, make and Python. A line that is not found exactly once is an error:
the list follows the core.
"""

import os
import shutil
import subprocess
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

HERE = Path(__file__).resolve().parent
CORE = HERE.parents[2] / "firmware_io" / "firmware"


#: Processor time of a check, which takes 4 s: a mutant that waits for ever has been noticed.
MOST_S = 300


class Mutant(NamedTuple):
    """A text of one file of the core, and what takes its place."""

    file: str
    text: str
    change: str

    def write(self, core: Path) -> None:
        """Copy the core into a folder, changed."""
        for path in (*CORE.glob("*.c"), *CORE.glob("*.h")):
            shutil.copy(path, core)
        path = core / self.file
        source = path.read_text()
        if source.count(self.text) != 1:
            raise SystemExit(f"{self.file} has {self.text!r} {source.count(self.text)} times.")
        path.write_text(source.replace(self.text, self.change))


_TABLE = tomllib.loads((HERE / "mutants.toml").read_text())
IN_C_ALONE = [Mutant(*fields) for fields in _TABLE["in_c_alone"]]
IN_PYTHON_ALONE = [Mutant(*fields) for fields in _TABLE["in_python_alone"]]
SENSING = [Mutant(*fields) for fields in _TABLE["sensing"]]
MUTANTS = [Mutant(*fields) for fields in _TABLE["mutants"]] + IN_C_ALONE + SENSING


def survives(mutant: Mutant, command: list[str] | None = None) -> bool:
    """Whether a mutant passes `make check`, or another command that finds it by CORE."""
    with TemporaryDirectory() as folder:
        core, build = Path(folder, "core"), Path(folder, "build")
        core.mkdir()
        mutant.write(core)
        # A mutant may leave a variable unused, or compare what is always true.
        values = (f"CORE={core}", f"BUILD={build}", f"STRICT=-std=c99 -w -I{core}")
        command = command or ["make", "-C", str(HERE), *values, "check"]
        done = subprocess.run(
            ["sh", "-c", f'ulimit -t {MOST_S}; exec "$@"', "sh", *command],
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, "CORE": str(core)},
        )
        if "error:" in done.stderr.replace("runtime error:", ""):
            raise SystemExit(f"{mutant} does not compile: {done.stderr}")
        return done.returncode == 0


def main() -> int:
    """Report the mutants that survive; return how many do."""
    left = 0
    with ThreadPoolExecutor(2) as pool:
        for mutant, alive in zip(MUTANTS, pool.map(survives, MUTANTS), strict=True):
            if alive:
                left += 1
                sys.stdout.write(f"survives: {mutant}\n")
                sys.stdout.flush()
    sys.stdout.write(f"{len(MUTANTS)} mutants, {left} survive.\n")
    return left


if __name__ == "__main__":
    sys.exit(main())
