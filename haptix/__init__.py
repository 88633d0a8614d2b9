"""Haptic rendering for electrovibration touchscreens: from contact mechanics to volts.

Data flows one way: `Finger` and `Screen` make a `ContactModel`; its solutions fill a
`FrictionSurface`; a `Renderer` inverts that surface under a moving finger for a `Texture`, and
streams the voltage to a device of `firmware_io`. The public names stand in ``__init__.pyi`` and
load on first use, so that importing haptix does not import torch.
"""

import os

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

if os.environ.get("HAPTIX_LOG"):
    from haptix.log import start_as_environment_says

    start_as_environment_says()
