"""Surfaces built before, found again by the hash of everything that decides their numbers."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from haptix.errors import FileFormatError
from haptix.friction import ContactModel
from haptix.surface.identity import surface_key
from haptix.surface.surface import FrictionSurface
from haptix.surface.tolerance import Tolerance


def cache_folder() -> Path:
    """Return ``$HAPTIX_CACHE``, or ``haptix`` in the user's cache folder."""
    chosen = os.environ.get("HAPTIX_CACHE")
    if chosen:
        return Path(chosen).expanduser()
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "haptix"


def cached_surface(
    model: ContactModel,
    scene: Any,
    tolerance: Tolerance | float | str,
    on_progress: Callable[[float], None] | None = None,
) -> tuple[FrictionSurface, bool]:
    """Load the surface of these inputs or build and keep it; say whether it was found.

    A cache entry that cannot be read is built again, and a cache that cannot be written is done
    without: neither can change a result.
    """
    key = surface_key(model, scene, tolerance)
    path = cache_folder() / f"{key}.surface"
    with suppress(FileFormatError):
        surface = FrictionSurface.load(path)
        if surface.info.get("key") == key:
            return surface, True
    surface = FrictionSurface.build(model, scene, tolerance, on_progress)
    with suppress(FileFormatError, OSError):
        surface.save(path)
    return surface, False
