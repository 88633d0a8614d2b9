"""Make clients/engine/src/engine.wasm of the engine's C, with ziglang.

With `--check FILE` it writes there instead, for a test that compares both.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE, NATIVE = ROOT / "clients" / "engine", ROOT / "haptix" / "base" / "native"
PARTS = ("block", "engine", "fingers", "map", "material", "program", "pyramid", "touch")
FLAGS = (
    *("-target", "wasm32-wasi", "-mexec-model=reactor", "-std=c99", "-O2", "-s"),
    *("-Wall", "-Wextra", "-Werror", "-ffp-contract=off", "-Wl,--no-entry"),
)


def make(out: Path) -> None:
    """Compile to a file."""
    sources = [PACKAGE / "engine.c", *(NATIVE / f"haptix_{part}.c" for part in PARTS)]
    subprocess.run(
        [
            *(sys.executable, "-m", "ziglang", "cc", *FLAGS, f"-I{NATIVE}"),
            *(str(source) for source in sources),
            *("-o", str(out)),
        ],
        check=True,
        cwd=ROOT,
    )
    out.chmod(0o644)


if __name__ == "__main__":
    make(Path(sys.argv[2]) if sys.argv[1:2] == ["--check"] else PACKAGE / "src" / "engine.wasm")
