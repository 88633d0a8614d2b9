"""Files that appear whole or not at all."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from haptix.errors import FileFormatError


def write_whole(path: Path, data: bytes) -> None:
    """Write a file beside its name first, on the disk, then give it its name.

    Raises
    ------
    OSError
        If it cannot be written; nothing has changed then.
    """
    draft = path.with_name(f".{path.name}.part")
    try:
        with draft.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


def as_json(value: Any) -> bytes:
    """Plain values as JSON text; there is no NaN in it."""
    return (json.dumps(value, indent=2, allow_nan=False) + "\n").encode()


def read_json(path: Path) -> dict[str, Any]:
    """Read an object from a JSON file.

    Raises
    ------
    FileFormatError
        If the file is missing or holds no JSON object.
    """
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise FileFormatError(f"cannot read {path}: {error.strerror}") from None
    except ValueError as error:
        raise FileFormatError(f"{path}: expected JSON, got: {error}") from None
    if not isinstance(value, dict):
        raise FileFormatError(f"{path}: expected a JSON object, got {type(value).__name__}")
    return value
