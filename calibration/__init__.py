"""Calibration of one screen: plan, measure, reduce, fit, verify. Each step can be repeated.

The result is a profile that `haptix.Screen.load` reads. The public names stand in
``__init__.pyi`` and load on first use, so that ``--help`` does not wait for torch.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
