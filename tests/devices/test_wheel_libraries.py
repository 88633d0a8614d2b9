"""The firmware in the wheels of other platforms: 3000 random programs through each, emulated.

The library is the one of the wheel; the program that calls it is the firmware's own check.
"""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from runpy import run_path

import pytest

import haptix
from c_libraries import LIBRARIES

ROOT = Path(haptix.__file__).parents[1]
FIRMWARE = ROOT / "firmware_io" / "firmware"
CHECKS = ROOT / "tests" / "firmware_io" / "firmware"
ARM_LIBC = Path("/usr/aarch64-linux-gnu")  # Debian's libc6-arm64-cross
pytestmark = pytest.mark.devices

# Target of hatch_build.py, and what runs its programs.
EMULATED = {
    "linux-x86_64": [],
    "linux-aarch64": ["qemu-aarch64", "-L", str(ARM_LIBC)],
    "windows-x86_64": ["wine"],  # finds the library beside the program
}


@pytest.mark.parametrize("target", EMULATED)
def test_random_programs_through_the_library_of_a_wheel(target, tmp_path):
    emulator = EMULATED[target]
    if emulator and not shutil.which(emulator[0]):
        pytest.skip(f"{emulator[0]} is not installed")
    if "-L" in emulator and not ARM_LIBC.is_dir():
        pytest.skip(f"{ARM_LIBC} is missing: Debian's libc6-arm64-cross")
    pytest.importorskip("ziglang", reason="the extra release")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", tmp_path],
        cwd=ROOT, env={**os.environ, "HAPTIX_TARGET": target}, check=True, capture_output=True,
    )  # fmt: skip
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as file:
        (name,) = (one for one in file.namelist() if "/haptix-firmware." in one)
        library = tmp_path / Path(name).name
        library.write_bytes(file.read(name))
    triple = run_path(str(ROOT / "hatch_build.py"))["TARGETS"][target].triple
    sizes = LIBRARIES["haptix-firmware"].flags
    program = tmp_path / "check.exe"
    beside = [] if library.suffix == ".dll" else ["-Wl,-rpath,$ORIGIN"]
    subprocess.run(
        [sys.executable, "-m", "ziglang", "cc", "-target", triple, *sizes, "-I", FIRMWARE,
         CHECKS / "check.c", library, *beside, "-o", program],
        check=True, capture_output=True,
    )  # fmt: skip
    own = {"WINEPREFIX": str(tmp_path / "wine"), "WINEDEBUG": "-all", "DISPLAY": ""}
    own["WINEDLLOVERRIDES"] = "mscoree,mshtml="  # else Wine waits for their downloads
    done = subprocess.run(
        [*emulator, program], capture_output=True, text=True, check=False,
        env={**os.environ, **own},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "No output above the ceiling, the slew, the energy or the mean" in done.stdout
