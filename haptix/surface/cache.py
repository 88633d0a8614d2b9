"""Cache of surfaces, by the hash of everything that decides their numbers."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

from haptix.errors import FileFormatError
from haptix.files import cache_folder
from haptix.friction import ContactModel
from haptix.surface.request import surface_key
from haptix.surface.surface import FrictionSurface
from haptix.surface.tolerance import Tolerance


def cached_surface(
    model: ContactModel,
    scene: Any,
    tolerance: Tolerance | float | str,
    on_progress: Callable[[float], None] | None = None,
) -> tuple[FrictionSurface, bool]:
    """Load the surface of these inputs, or build and keep it; also return whether it was found.

    An entry that cannot be read is built again. A cache that cannot be written is not used. Neither
    changes a result.
    """
    key = surface_key(model, scene, tolerance)
    path = cache_folder() / f"{key}.surface"
    with suppress(FileFormatError):
        surface = FrictionSurface.load(path)
        if surface.info.get("key") == key:
            return surface, True
    surface = FrictionSurface.build(model, scene, tolerance, on_progress)
    with suppress(FileFormatError):
        surface.save(path)
    return surface, False
