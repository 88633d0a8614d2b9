"""Make the WebAssembly in clients/engine/src of the engine's C and of the firmware's, with ziglang.

With `--check FOLDER` it writes there instead, for a test that compares both.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE, NATIVE = ROOT / "clients" / "engine", ROOT / "haptix" / "base" / "native"
FIRMWARE = ROOT / "firmware_io" / "firmware"
PARTS = ("block", "engine", "fingers", "map", "material", "program", "pyramid", "touch")
SOURCES = {
    "engine": (NATIVE, [NATIVE / f"haptix_{part}.c" for part in PARTS]),
    "firmware": (FIRMWARE, sorted(FIRMWARE.glob("*.c"))),
}
# For size: of the engine -O2 makes a quarter more, which is a twelfth faster.
FLAGS = (
    *("-target", "wasm32-wasi", "-mexec-model=reactor", "-std=c99", "-Os", "-s"),
    *("-Wall", "-Wextra", "-Werror", "-ffp-contract=off", "-Wl,--no-entry"),
)


def make(folder: Path) -> None:
    """Compile both into a folder."""
    for name, (headers, sources) in SOURCES.items():
        out = folder / f"{name}.wasm"
        command = [sys.executable, "-m", "ziglang", "cc", *FLAGS, f"-I{headers}"]
        subprocess.run([*command, PACKAGE / f"{name}.c", *sources, "-o", out], check=True, cwd=ROOT)
        out.chmod(0o644)


if __name__ == "__main__":
    make(Path(sys.argv[2]) if sys.argv[1:2] == ["--check"] else PACKAGE / "src")
