"""A pytest plugin: the firmware in the folder CORE plays in the place of the package's."""

import os
import subprocess
from pathlib import Path
from runpy import run_path

from firmware_io import c_library

_NAME = "haptix-firmware"
_TABLE = run_path(str(Path(__file__).parents[3] / "c_libraries.py"))["LIBRARIES"]


def pytest_configure() -> None:
    """Build that firmware, and have it loaded."""
    core = Path(os.environ["CORE"])
    path = core / "firmware.so"
    sources = [core / name for name in _TABLE[_NAME].sources]
    flags = ("-std=c99", "-O1", "-w", "-shared", "-fPIC", *_TABLE[_NAME].flags)
    subprocess.run(["cc", *flags, *sources, "-o", path], check=True)
    found = c_library._path
    c_library._path = lambda name, folder, build="built": (
        path if name == _NAME else found(name, folder, build)
    )
