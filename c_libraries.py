"""The libraries in C, and the programs of the Pico boards: what they are made of and built by.

A wheel brings them; `hatch_build.py` puts them there. A checkout keeps them in build/libraries/,
from the installation on, and builds them again when a source has changed: whoever loads one asks
`built` for its path. This file is no part of a package, since an installed wheel has no use for it.
"""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Callable, Iterable
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent
#: The boards whose program needs no more than ziglang, so that a wheel can bring it.
PICO = ROOT / "examples" / "boards" / "pico"
PICO_CORES = {"haptix-pico": "cortex_m0plus", "haptix-pico2": "cortex_m33+soft_float"}


class Library(NamedTuple):
    """The sources of one library, in a folder with their headers, and the flags of its own."""

    folder: str
    sources: tuple[str, ...]
    flags: tuple[str, ...] = ()


LIBRARIES = {
    "haptix-firmware": Library(
        "firmware_io/firmware",
        (
            "haptix_wire.c",
            "haptix_receive.c",
            "haptix_session.c",
            "haptix_answer.c",
            "haptix_output.c",
            "haptix_play.c",
            "haptix_sine.c",
            "haptix_window.c",
            "haptix_seal.c",
            "haptix_proof.c",
            "haptix_sense.c",
            "haptix_host.c",  # for hosts alone
        ),
        # A desktop has memory for the longest frame of the format and a queue of 2.7 s at 48 kHz.
        ("-DHX_QUEUE_SAMPLES=131072u", "-DHX_MAX_FRAME_SAMPLES=32765u", "-DHX_READINGS=256u"),
    ),
    "haptix-player": Library(
        "firmware_io/player",
        ("haptix_player.c", "../firmware/haptix_host.c", "../firmware/haptix_wire.c"),
        ("-lm",),
    ),
    "haptix-native": Library(
        "haptix/base/native",
        (
            "haptix_block.c",
            "haptix_contact.c",
            "haptix_engine.c",
            "haptix_fingers.c",
            "haptix_live.c",
            "haptix_map.c",
            "haptix_material.c",
            "haptix_program.c",
            "haptix_pyramid.c",
            "haptix_surface.c",
            "haptix_touch.c",
            "haptix_waves.c",
        ),
        # The same results on all machines: no product is added without being rounded.
        ("-ffp-contract=off", "-lm"),
    ),
}

_FLAGS = ("-std=c99", "-O2", "-shared")


class BuildError(RuntimeError):
    """A library cannot be built."""


def built(name: str) -> Path:
    """Return the path of a library of this checkout, built from its sources as they are now.

    Raises
    ------
    BuildError
        If there is no compiler, it refuses the sources, or what it makes cannot be kept.
    """
    library = LIBRARIES[name]
    folder = ROOT / library.folder
    sources = [folder / source for source in library.sources]
    sources += sorted({header for source in sources for header in source.parent.glob("*.h")})
    suffix = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
    options = repr((library, _FLAGS, sysconfig.get_platform()))
    return _kept(name, suffix, options, sources, lambda path: compile_library(name, path))


def built_pico(name: str) -> Path:
    """Return the path of a Pico board's program, built from its sources as they are now.

    Raises
    ------
    BuildError
        If ziglang is missing, it refuses the sources, or what it makes cannot be kept.
    """
    sources = sorted(
        path
        for folder in (PICO, PICO.parent / "usb", ROOT / "firmware_io" / "firmware")
        for path in folder.iterdir()
        if path.suffix in (".c", ".h", ".S", ".ld", ".txt")
    )
    return _kept(name, ".bin", PICO_CORES[name], sources, lambda path: compile_pico(name, path))


def _kept(
    name: str,
    suffix: str,
    options: str,
    sources: Iterable[Path],
    compile_to: Callable[[Path], None],
) -> Path:
    """Return the path of what is compiled from sources, and kept under their hash."""
    digest = hashlib.sha256(options.encode())
    for path in sources:
        digest.update(path.read_bytes())
    kept = ROOT / "build" / "libraries" / f"{name}-{digest.hexdigest()[:16]}{suffix}"
    if kept.exists():
        return kept
    try:
        kept.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=kept.parent) as own:
            compile_to(Path(own) / kept.name)
            # When complete: no process ever loads half a library, and two may build it at once.
            (Path(own) / kept.name).replace(kept)
    except OSError as error:
        raise BuildError(
            f"cannot keep {name} in {kept.parent}: {error.strerror or error}; make room there, and "
            "let this user write there."
        ) from None
    return kept


def compile_pico(name: str, path: Path) -> None:
    """Compile a Pico board's program to `path`: bytes of its flash, without check sums.

    Raises
    ------
    BuildError
        If ziglang is missing, or it refuses the sources.
    """
    if not find_spec("ziglang"):
        raise BuildError("To build the Pico's firmware, ziglang is needed: pip install ziglang.")
    zig = [sys.executable, "-m", "ziglang"]
    core = sorted((ROOT / "firmware_io" / "firmware").glob("haptix_*.c"))
    sources = [
        *sorted(PICO.glob("*.[cS]")),
        *(source for source in core if source.name != "haptix_host.c"),
    ]
    flags = (PICO / "flags.txt").read_text().split()
    with TemporaryDirectory() as own:
        elf = str(Path(own) / "pico.elf")
        for command in (
            [
                *(*zig, "cc", "-target", "thumb-freestanding-eabi", "-s"),
                f"-mcpu={PICO_CORES[name]}",
                *(*flags, f"-I{PICO}", f"-I{core[0].parent}", "-T", str(PICO / "pico.ld")),
                *(*map(str, sources), "-o", elf),
            ],
            [*zig, "objcopy", "-O", "binary", elf, str(path)],
        ):
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode != 0:
                raise BuildError(f"ziglang could not compile the Pico's firmware: {done.stderr}")


def compile_library(name: str, path: Path, triple: str = "") -> None:
    """Compile a library to `path`: for this machine, or for the target that ziglang calls `triple`.

    Raises
    ------
    BuildError
        If there is no compiler, or it refuses the sources.
    """
    library = LIBRARIES[name]
    compiler = _compiler(triple)
    if not path.name.endswith(".dll"):
        compiler.append("-fPIC")
    sources = [str(ROOT / library.folder / source) for source in library.sources]
    done = subprocess.run(
        [*compiler, *_FLAGS, *sources, *library.flags, "-o", str(path)],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise BuildError(
            f"{shlex.join(compiler)} could not compile {name}; install another compiler (pip "
            f"install ziglang), or name one by the variable CC. It said: {done.stderr.strip()}"
        )


def _compiler(triple: str) -> list[str]:
    if find_spec("ziglang"):
        # No instruction that other machines with this architecture lack.
        target = ("-target", triple) if triple else ("-mcpu=baseline",)
        return [sys.executable, "-m", "ziglang", "cc", "-s", *target]
    if triple:
        raise BuildError(f"To build for {triple}, ziglang is needed: pip install ziglang.")
    for command in (os.environ.get("CC", ""), "cc", "gcc", "clang"):
        words = shlex.split(command)
        if words and shutil.which(words[0]):
            return words
    raise BuildError(
        "haptix needs a C compiler to build its libraries, but neither ziglang nor $CC, cc, gcc or "
        "clang was found: pip install ziglang, or name a compiler by the variable CC."
    )
