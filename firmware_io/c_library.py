"""Libraries in C: from the wheel, or built from the present sources of a checkout."""

from __future__ import annotations

import re
from pathlib import Path
from runpy import run_path
from typing import Any

import cffi

from firmware_io.device_errors import DeviceError


def load(name: str, *headers: Path) -> tuple[cffi.FFI, Any]:
    """Load the library that lies beside its headers; cffi reads what they mark for it.

    Raises `DeviceError` if it is missing and cannot be built, or cannot be loaded.
    """
    ffi = cffi.FFI()
    for header in headers:
        declared = re.search(
            r"/\* cffi: begin \*/(.*)/\* cffi: end \*/", header.read_text(), re.DOTALL
        )
        assert declared is not None
        ffi.cdef(declared.group(1))
    path = _path(name, headers[0].parent)
    try:
        return ffi, ffi.dlopen(str(path))
    except OSError as error:
        raise DeviceError(
            f"The compiled library {path} cannot be loaded: {error}; remove it and install haptix "
            "again."
        ) from error


def pico_program(board: str) -> Path:
    """Return the path of a Pico board's program: bytes of its flash, without check sums.

    Raises `DeviceError` if it is missing and cannot be built.
    """
    return _path(f"haptix-{board}", Path(__file__).parent / "firmware", "built_pico")


def _path(name: str, folder: Path, build: str = "built") -> Path:
    builder = Path(__file__).parents[1] / "c_libraries.py"
    if not builder.is_file():
        return next(folder.glob(f"{name}.*"), folder / name)
    checkout = run_path(str(builder))
    try:
        path: Path = checkout[build](name)
    except checkout["BuildError"] as error:
        raise DeviceError(str(error)) from None
    return path
