"""Hashes of everything that decides the numbers of a surface."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from haptix.friction import ContactModel
from haptix.surface.ranges import read_ranges
from haptix.surface.tolerance import LARGEST_BYTES, Tolerance
from haptix.version import __version__


def digest(plain: Mapping[str, Any]) -> str:
    """SHA-256 of plain values, such as the description of a model or of a file."""
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()


def surface_key(
    model: ContactModel,
    scene: Any,
    tolerance: Tolerance | float | str,
    largest_bytes: int = LARGEST_BYTES,
) -> str:
    """Hash of everything that decides a surface's numbers; the name of its cache entry."""
    return digest(
        {
            "haptix": __version__,
            "code": _code_digest(),
            "model": model.describe(),
            "response_hz_per_mm_per_s": model.finger.response_hz_per_mm_per_s,
            "ranges": read_ranges(model, scene),
            "tolerance": str(Tolerance.read(tolerance)),
            "largest_bytes": largest_bytes,
        }
    )


@cache
def _code_digest() -> str:
    """Hash of the source code: a surface of an earlier solver is never found in the cache."""
    code = hashlib.sha256()
    package = Path(__file__).parent.parent
    folders = [
        package / folder
        for folder in ("contact", "electro", "terms", "fidelity", "friction", "surface")
    ]
    for file in sorted(
        [*package.glob("*.py"), *(f for folder in folders for f in folder.rglob("*.py"))]
    ):
        code.update(file.read_bytes())
    return code.hexdigest()
