"""Haptic rendering for electrovibration touchscreens: from contact mechanics to volts.

Data flows one way: `Finger` and `Screen` make a `ContactModel`; its solutions fill a
`FrictionSurface`; a `Renderer` inverts that surface under a moving finger for a `Texture`, and
streams the voltage to a device of `firmware_io`. The names below load on first use, so that
importing haptix does not import torch.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from haptix.version import __version__

if TYPE_CHECKING:
    from firmware_io import open_device
    from haptix.errors import HaptixError, InputError, LimitError
    from haptix.finger import Finger
    from haptix.friction import ContactModel
    from haptix.render import Renderer, Trajectory
    from haptix.scene import Scene
    from haptix.screen import Screen
    from haptix.states import ContactState
    from haptix.status import Status
    from haptix.surface import FrictionSurface
    from haptix.texture import Texture

__all__ = [
    "ContactModel",
    "ContactState",
    "Finger",
    "FrictionSurface",
    "HaptixError",
    "InputError",
    "LimitError",
    "Renderer",
    "Scene",
    "Screen",
    "Status",
    "Texture",
    "Trajectory",
    "__version__",
    "open_device",
]

_HOME = {
    "ContactModel": "haptix.friction",
    "ContactState": "haptix.states",
    "Finger": "haptix.finger",
    "FrictionSurface": "haptix.surface",
    "HaptixError": "haptix.errors",
    "InputError": "haptix.errors",
    "LimitError": "haptix.errors",
    "Renderer": "haptix.render",
    "Scene": "haptix.scene",
    "Screen": "haptix.screen",
    "Status": "haptix.status",
    "Texture": "haptix.texture",
    "Trajectory": "haptix.render",
    "contact": "haptix.contact",
    "open_device": "firmware_io",
    "stimuli": "haptix.stimuli",
    "virtual_finger": "haptix.virtual_finger",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'haptix' has no attribute {name!r}")
    module = import_module(_HOME[name])
    value = module if _HOME[name] == f"haptix.{name}" else getattr(module, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, "contact", "stimuli", "virtual_finger"])
