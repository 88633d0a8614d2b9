"""Haptic rendering for electrovibration touchscreens: from contact mechanics to volts.

Data flows one way: `Finger` and `Screen` make a `ContactModel`; its solutions fill a
`FrictionSurface`; a `Renderer` inverts that surface under a moving finger for a `Texture`, and
streams the voltage to a device of `firmware_io`. The public names stand in ``__init__.pyi`` and
load on first use, so that importing haptix does not import torch.
"""

import os
import sys

if "".join(sys.argv[:1]).endswith(("/haptix", "\\haptix", "\\haptix.exe", "-m")):
    # In the command, Ctrl-C while it loads prints no traceback. Other programs decide themselves.
    _before = sys.excepthook
    sys.excepthook = lambda kind, *error: (
        None if kind is KeyboardInterrupt else _before(kind, *error)
    )

import lazy_loader

_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    try:
        return _load(name)
    except AttributeError as error:
        error.name, error.obj = name, sys.modules[__name__]  # Python then suggests similar names
        raise
    except ImportError as error:
        from haptix.base.version import foreign_package

        if advice := foreign_package("firmware_io"):
            raise ImportError(advice) from error
        raise


if os.environ.get("HAPTIX_LOG"):
    from haptix.base.log import start_as_environment_says

    start_as_environment_says()
