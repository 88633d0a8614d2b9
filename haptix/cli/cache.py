"""``haptix cache``."""

from __future__ import annotations

import re
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import typer

from haptix.errors import InputError
from haptix.files import cache_folder
from haptix.terminal import AsJson, show

# Results are named by a hash, so that what somebody has put there is told from them. An earlier
# version kept each surface in one file.
_KEPT = re.compile(r"results/[0-9a-f]{2}/[0-9a-f]{64}/[^/]+|\.?[0-9a-f]{64}\.surface.*")


def cache(
    clear: Annotated[bool, typer.Option("--clear", help="Remove it; it is made again.")] = False,
    as_json: AsJson = False,
) -> None:
    """List what is kept so that it is not made twice, or remove it.

    Profiles of calibrated screens and the files of apps are no cache, and are left alone.
    """
    try:
        folder = cache_folder()
        inside = [*folder.iterdir(), *folder.glob("results/*/*/*")] if folder.is_dir() else []
        surfaces = sorted(p for p in inside if _KEPT.fullmatch(p.relative_to(folder).as_posix()))
        rows = [_row("surfaces", surfaces, folder)]
    except OSError as error:
        raise InputError(f"cannot read {error.filename}: {error.strerror}") from None
    if clear:
        _remove(surfaces)
    show("removed from the cache" if clear else "cache; --clear removes it", rows, as_json)


def _row(kind: str, files: list[Path], folder: Path) -> dict[str, Any]:
    return {
        "kept": kind,
        "files": len(files),
        "bytes": sum(path.lstat().st_size for path in files),
        "folder": str(folder) if files else "-",
    }


def _remove(files: Iterable[Path]) -> None:
    wrong = []
    for path in files:
        try:
            path.unlink(missing_ok=True)
            with suppress(OSError):  # it is not empty yet
                path.parent.rmdir()
        except OSError as error:
            wrong.append(f"{path}: {error.strerror}")
    if wrong:
        raise InputError(
            f"cannot remove {len(wrong)} files of the cache, such as {wrong[0]}; end the programs "
            "that use them, and try again"
        )
