"""Cache of surfaces, by the hash of everything that decides their numbers."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from haptix.errors import FileFormatError
from haptix.files import cache_folder
from haptix.friction import ContactModel
from haptix.results import ResultStore, folder_of
from haptix.surface.request import surface_key
from haptix.surface.surface import FrictionSurface
from haptix.surface.tolerance import Tolerance

_FILE = "friction.surface"


def cached_surface(
    model: ContactModel,
    scene: Any,
    tolerance: Tolerance | float | str,
    on_progress: Callable[[float], None] | None = None,
) -> tuple[FrictionSurface, bool]:
    """Load the surface of these inputs, or build and keep it; also return whether it was found.

    An entry that is not what was written is built again. A cache that cannot be read or written is
    not used. Neither changes a result.
    """
    key = surface_key(model, scene, tolerance)
    store = ResultStore(cache_folder())
    with suppress(FileFormatError, OSError):
        if store.check(key)[0] is not None:
            return FrictionSurface.load(Path(store.where, folder_of(key), _FILE)), True
    surface = FrictionSurface.build(model, scene, tolerance, on_progress)
    with suppress(FileFormatError, OSError):
        store.publish(key, {_FILE: surface.save}, {"kind": "surface"})
    return surface, False
