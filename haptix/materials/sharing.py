"""Evaluators of the same asset and parameters, made once."""

from __future__ import annotations

import json
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar
from weakref import WeakValueDictionary

from haptix.materials.material import Asset

Made = TypeVar("Made")

_SHARED: WeakValueDictionary[str, Any] = WeakValueDictionary()


def shared(asset: Asset, parameters: Any, make: Callable[[Path], Made]) -> Made:
    """Return what `make` makes of an asset; the same while anything holds it.

    Equal content and equal `parameters`, plain values, give the same object.
    """
    path = asset.path
    content = sha256(path.read_bytes()).hexdigest() if path.is_file() else str(path)
    key = json.dumps([content, parameters], sort_keys=True)
    found: Made | None = _SHARED.get(key)
    if found is None:
        found = _SHARED[key] = make(path)
    return found
