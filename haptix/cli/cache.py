"""``haptix cache``."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import typer

from haptix.errors import InputError
from haptix.files import cache_folder
from haptix.terminal import AsJson, show

# Surfaces are named by a hash, so that one which somebody has put there is told from them.
_SURFACE = re.compile(r"[0-9a-f]{64}\.surface|\.[0-9a-f]{64}\.surface\.[0-9a-f]+\.part")


def cache(
    clear: Annotated[bool, typer.Option("--clear", help="Remove it; it is made again.")] = False,
    as_json: AsJson = False,
) -> None:
    """List what is kept so that it is not made twice, or remove it.

    Profiles of calibrated screens and the files of apps are no cache, and are left alone.
    """
    from firmware_io.firmware.build import compiled_files

    try:
        folder = cache_folder()
        inside = folder.iterdir() if folder.is_dir() else ()
        found = {
            "surfaces": sorted(path for path in inside if _SURFACE.fullmatch(path.name)),
            "compiled firmware": compiled_files(),
        }
        rows = [_row(kind, files) for kind, files in found.items()]
    except OSError as error:
        raise InputError(f"cannot read {error.filename}: {error.strerror}") from None
    if clear:
        _remove(path for files in found.values() for path in files)
    show("removed from the cache" if clear else "cache; --clear removes it", rows, as_json)


def _row(kind: str, files: list[Path]) -> dict[str, Any]:
    folders = dict.fromkeys(str(path.parent) for path in files)
    return {
        "kept": kind,
        "files": len(files),
        "bytes": sum(path.lstat().st_size for path in files),
        "folder": ", ".join(folders) or "-",
    }


def _remove(files: Iterable[Path]) -> None:
    wrong = []
    for path in files:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            wrong.append(f"{path}: {error.strerror}")
    if wrong:
        raise InputError(
            f"cannot remove {len(wrong)} files of the cache, such as {wrong[0]}; end the programs "
            "that use them, and try again"
        )
