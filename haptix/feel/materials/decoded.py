"""A cache of the pixels of pictures that another process has decoded.

A hostile file does its harm in a decoder, and a large one takes long there. So the service's engine
decodes nothing. A worker decodes, in a process that may die, and writes the pixels to the cache.
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

from haptix.base.errors import FileFormatError, InputError
from haptix.base.files import write_failure

LARGEST_BYTES = 2_200_000_000
"""Default limit of the memory that making a texture takes: `MOST_KEPT` in colour, with opacity."""

MOST_PIXELS, MOST_KEPT = 200_000_000, 24_000_000
"""Pixels of a picture's file, and those that are kept of it: 0.05 mm of 245 mm by 245 mm."""

FOLDER = "decoded"
"""Name of the cache's folder, beside the service's folder of assets."""

PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".avif")
"""Suffixes of the files that are decoded."""

MOST_BYTES = 2 * 2**30
"""Size of the cache; the oldest pixels are deleted first."""

Pixels = tuple[np.ndarray[Any, Any], bool]

_HASH = re.compile("[0-9a-f]{64}")

_ENDINGS = {False: ".npy", True: ".premultiplied.npy"}


class _Place(NamedTuple):
    folder: Path
    makes: bool


_place: _Place | None = None


def keep_in(folder: Path, makes: bool) -> None:
    """Let this process read pixels from a folder, and write to it if it may decode.

    Parameters
    ----------
    folder : Path
        The cache: pixels by the hash of their file.
    makes : bool
        Whether this process decodes a file that is not in the cache; if not, `decoded` raises
        `InputError`.
    """
    global _place
    _place = _Place(folder, makes)


def is_kept(folder: Path, digest: str) -> bool:
    """Whether the cache has the pixels of a file."""
    return any((folder / f"{digest}{ending}").is_file() for ending in _ENDINGS.values())


def decoded(path: Path, make: Callable[[], Pixels]) -> Pixels:
    """Return the pixels of a file, and whether they are premultiplied by their opacity.

    Raises `InputError` if this process may not decode, and the cache does not have the file;
    `FileFormatError` if the pixels cannot be kept, as on a full disk.

    Parameters
    ----------
    path : Path
        A file whose name is the hash of its content.
    make : callable
        Decodes the file.
    """
    if _place is None or not _HASH.fullmatch(path.stem):
        return make()
    for premultiplied, ending in _ENDINGS.items():
        kept = _place.folder / f"{path.stem}{ending}"
        try:
            return np.load(kept, mmap_mode="r"), premultiplied
        except (EOFError, ValueError):  # it is damaged: made anew, and not taken for decoded
            with suppress(OSError):
                kept.unlink()
        except OSError:
            continue
    if not _place.makes:
        raise InputError(f"image: {path.name} is not decoded yet; send the layout again")
    pixels, premultiplied = make()
    target = _place.folder / f"{path.stem}{_ENDINGS[premultiplied]}"
    try:
        _write(target, pixels)
    except OSError as error:
        why = write_failure(error, target)
        raise FileFormatError(f"cannot keep the pixels of {path.name}: {why}") from error
    return pixels, premultiplied


def _write(target: Path, pixels: np.ndarray[Any, Any]) -> None:
    target.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    files = sorted(target.parent.glob("*.npy"), key=lambda file: file.stat().st_mtime)
    size = pixels.nbytes + sum(file.stat().st_size for file in files)
    for oldest in files:
        if size <= MOST_BYTES:
            break
        size -= oldest.stat().st_size
        with suppress(OSError):  # some systems refuse while another process maps the file
            oldest.unlink()
    handle, draft = tempfile.mkstemp(dir=target.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            np.save(file, pixels)
        Path(draft).replace(target)
    finally:
        Path(draft).unlink(missing_ok=True)
