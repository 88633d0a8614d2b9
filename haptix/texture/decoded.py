"""Pixels of pictures that another process has decoded.

A decoder is the place where a hostile file does its harm, and where a large one takes its time. The
service's engine decodes nothing: a worker does, in a process that may die, and keeps the pixels.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from haptix.errors import InputError

LARGEST_BYTES = 1_500_000_000
"""Default limit of the memory that making a texture takes: some 24 megapixels."""

FOLDER = "decoded"
"""Beside the service's folder of assets."""

PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
"""Files that are decoded, by their ends."""

MOST_BYTES = 2 * 2**30
"""Of the pixels that are kept; the oldest go first."""

Pixels = tuple[np.ndarray[Any, Any], bool]

_HASH = re.compile("[0-9a-f]{64}")

_ENDINGS = {False: ".npy", True: ".premultiplied.npy"}


class _Place(NamedTuple):
    folder: Path
    makes: bool


_place: _Place | None = None


def keep_in(folder: Path, makes: bool) -> None:
    """Let this process keep pixels in a folder, or read no others.

    Parameters
    ----------
    folder : Path
        Of pixels, by the hash of their file.
    makes : bool
        Whether it decodes what is not there; otherwise that raises `InputError`.
    """
    global _place
    _place = _Place(folder, makes)


def is_kept(folder: Path, digest: str) -> bool:
    """Whether the pixels of a file are there."""
    return any((folder / f"{digest}{ending}").is_file() for ending in _ENDINGS.values())


def decoded(path: Path, make: Callable[[], Pixels]) -> Pixels:
    """Return the pixels of a file, and whether they are premultiplied by their opacity.

    Parameters
    ----------
    path : Path
        Of a file that is called by the hash of its content.
    make : callable
        Decodes it.

    Raises
    ------
    InputError
        If this process decodes nothing, and nothing is kept.
    """
    if _place is None or not _HASH.fullmatch(path.stem):
        return make()
    for premultiplied, ending in _ENDINGS.items():
        with suppress(OSError, ValueError):
            return np.load(_place.folder / f"{path.stem}{ending}", mmap_mode="r"), premultiplied
    if not _place.makes:
        raise InputError(f"image: {path.name} is not decoded yet; send the layout again")
    pixels, premultiplied = make()
    _write(_place.folder / f"{path.stem}{_ENDINGS[premultiplied]}", pixels)
    return pixels, premultiplied


def _write(target: Path, pixels: np.ndarray[Any, Any]) -> None:
    target.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    files = sorted(target.parent.glob("*.npy"), key=lambda one: one.stat().st_mtime)
    size = pixels.nbytes + sum(one.stat().st_size for one in files)
    for oldest in files:
        if size <= MOST_BYTES:
            break
        size -= oldest.stat().st_size
        with suppress(OSError):  # another process maps it, on systems that mind
            oldest.unlink()
    handle, draft = tempfile.mkstemp(dir=target.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            np.save(file, pixels)
        Path(draft).replace(target)
    finally:
        Path(draft).unlink(missing_ok=True)
