"""The firmware as a shared library, compiled on first use and kept in the user's cache."""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
import subprocess
import tempfile
from pathlib import Path

import platformdirs

from firmware_io.errors import DeviceError

SOURCE_DIR = Path(__file__).parent
SOURCES = (
    "haptix_wire.c",
    "haptix_receive.c",
    "haptix_session.c",
    "haptix_answer.c",
    "haptix_play.c",
    "haptix_window.c",
)
HEADERS = ("haptix_wire.h", "haptix_device.h", "haptix_internal.h", "haptix_sine.h")

#: A desktop has memory for the longest frame of the format and a queue of 2.7 s at 48 kHz.
QUEUE_SAMPLES = 1 << 17
FRAME_SAMPLES = 32765
_FLAGS = (
    "-std=c99",
    "-O2",
    "-fPIC",
    "-shared",
    f"-DHX_QUEUE_SAMPLES={QUEUE_SAMPLES}u",
    f"-DHX_MAX_FRAME_SAMPLES={FRAME_SAMPLES}u",
)


def find_compiler() -> list[str] | None:
    """Return the command of a C compiler: $CC, cc, gcc or clang; None if there is none."""
    for command in (os.environ.get("CC", ""), "cc", "gcc", "clang"):
        words = shlex.split(command)
        if words and shutil.which(words[0]):
            return words
    return None


def library() -> Path:
    """Return the path of the compiled firmware, building it if its sources have changed.

    Raises
    ------
    DeviceError
        If there is no compiler, or it refuses the sources.
    """
    compiler = find_compiler()
    if compiler is None:
        raise DeviceError(
            "The firmware in C needs a C compiler, but none of $CC, cc, gcc and clang was found; "
            'install one (on Debian: apt install gcc), or use the Python reference, core="python".'
        )
    path = _cache_dir() / f"haptix-firmware-{_key(compiler)}.so"
    if not path.exists():
        _compile(compiler, path)
    return path


def _key(compiler: list[str]) -> str:
    digest = hashlib.sha256(repr((compiler, _FLAGS, os.uname().machine)).encode())
    for name in (*SOURCES, *HEADERS):
        digest.update((SOURCE_DIR / name).read_bytes())
    return digest.hexdigest()[:16]


def _cache_dir() -> Path:
    path = platformdirs.user_cache_path("haptix", appauthor=False)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError:
        # The home cannot be written: a folder of this user alone, so that no other user plants a
        # library there.
        path = Path(tempfile.gettempdir()) / f"haptix-{os.getuid()}"
        path.mkdir(mode=0o700, exist_ok=True)
        if path.stat().st_uid != os.getuid():
            raise DeviceError(
                f"{path} belongs to another user; set XDG_CACHE_HOME to a folder of your own."
            ) from None
    return path


def _compile(compiler: list[str], path: Path) -> None:
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        built = Path(folder) / path.name
        sources = [str(SOURCE_DIR / name) for name in SOURCES]
        done = subprocess.run(
            [*compiler, *_FLAGS, *sources, "-o", str(built)], capture_output=True, text=True
        )
        if done.returncode != 0:
            raise DeviceError(
                f"{compiler[0]} could not compile the firmware: {done.stderr.strip()} Use another "
                'compiler (set CC), or the reference in Python, core="python".'
            )
        # Renamed when complete, so that another process never loads half a library.
        built.replace(path)
