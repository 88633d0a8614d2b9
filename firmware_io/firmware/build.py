"""The firmware as a shared library: in the wheel, or compiled on first use and kept in a cache."""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
import stat
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

import platformdirs

from firmware_io.errors import DeviceError
from firmware_io.firmware.flags import FLAGS, HOST_SOURCES, SOURCES

SOURCE_DIR = Path(__file__).parent
HEADERS = (
    "haptix_wire.h", "haptix_device.h", "haptix_internal.h", "haptix_sine.h", "haptix_host.h",
)  # fmt: skip

_FLAGS = (*FLAGS, "-fPIC")


def shipped() -> Path | None:
    """Return the firmware that was compiled when the wheel was built; None in a pure one."""
    suffix = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
    path = SOURCE_DIR / f"haptix-firmware{suffix}"
    return path if path.exists() else None


def can_be_had() -> bool:
    """Whether the firmware is there, or there is a compiler for it."""
    return shipped() is not None or find_compiler() is not None


def find_compiler() -> list[str] | None:
    """Return the command of a C compiler: $CC, cc, gcc or clang; None if there is none.

    What it makes is kept in a folder of this user alone, which only POSIX systems tell.
    """
    if os.name != "posix":
        return None
    for command in (os.environ.get("CC", ""), "cc", "gcc", "clang"):
        words = shlex.split(command)
        if words and shutil.which(words[0]):
            return words
    return None


def library() -> Path:
    """Return the path of the compiled firmware: the shipped one, or one built from the sources.

    Raises
    ------
    DeviceError
        If there is no compiler, it refuses the sources, or what it makes cannot be kept.
    """
    if found := shipped():
        return found
    compiler = find_compiler()
    if compiler is None:
        raise DeviceError(
            "The firmware in C needs a C compiler, but none of $CC, cc, gcc and clang was found; "
            'install one (on Debian: apt install gcc), or use the Python reference, core="python".'
        )
    path = _cache_folder() / file_name(_key(compiler))
    if not _is_as_built(path):
        try:
            _compile(compiler, path)
        except OSError as error:
            raise DeviceError(
                f"cannot keep the compiled firmware in {path.parent}: {error.strerror or error}. "
                'Make room there, or use the reference in Python, core="python".'
            ) from None
    return path


def _key(compiler: list[str]) -> str:
    digest = hashlib.sha256(repr((compiler, _FLAGS, os.uname().machine)).encode())
    for name in (*SOURCES, *HOST_SOURCES, *HEADERS):
        digest.update((SOURCE_DIR / name).read_bytes())
    return digest.hexdigest()[:16]


def file_name(key: str) -> str:
    """Return the name of a library that was compiled here."""
    return f"haptix-firmware-{key}.so"


def compiled_files() -> list[Path]:
    """Return what was compiled here and is kept: libraries and their check sums."""
    if os.name != "posix":
        return []
    folders = [path for path in _cache_folders() if path.is_dir() and _is_ours(path)]
    return [
        path
        for folder in folders
        for pattern in (file_name("*"), str(_seal(Path(file_name("*")))))
        for path in sorted(folder.glob(pattern))
    ]


def _cache_folders() -> tuple[Path, Path]:
    return (
        platformdirs.user_cache_path("haptix", appauthor=False),
        Path(tempfile.gettempdir()) / f"haptix-{os.getuid()}",
    )


def _cache_folder() -> Path:
    """Return a folder that nobody but this user can write; a library in it is run."""
    for path in _cache_folders():
        with suppress(OSError):
            path.mkdir(mode=0o700, parents=True, exist_ok=True)
            if _is_ours(path) and os.access(path, os.W_OK):
                return path
    return Path(tempfile.mkdtemp(prefix="haptix-"))


def _is_ours(path: Path) -> bool:
    known = path.lstat()
    return known.st_uid == os.getuid() and not known.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _seal(path: Path) -> Path:
    """Return the file beside a library that holds its check sum."""
    return path.with_suffix(".sha256")


def _is_as_built(path: Path) -> bool:
    try:
        seal = _seal(path).read_text()
        return _is_ours(path) and hashlib.sha256(path.read_bytes()).hexdigest() == seal
    except (OSError, UnicodeDecodeError):
        return False


def _compile(compiler: list[str], path: Path) -> None:
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        built = Path(folder) / path.name
        sources = [str(SOURCE_DIR / name) for name in (*SOURCES, *HOST_SOURCES)]
        done = subprocess.run(
            [*compiler, *_FLAGS, *sources, "-o", str(built)], capture_output=True, text=True
        )
        if done.returncode != 0:
            raise DeviceError(
                f"{compiler[0]} could not compile the firmware: {done.stderr.strip()} Use another "
                'compiler (set CC), or the reference in Python, core="python".'
            )
        seal = _seal(built)
        seal.write_text(hashlib.sha256(built.read_bytes()).hexdigest())
        # Renamed when complete, so that another process never loads half a library; the seal
        # first, since a library without its own is only built again.
        seal.replace(_seal(path))
        built.replace(path)
