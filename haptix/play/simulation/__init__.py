"""Rendering without hardware: a virtual finger feels the output of a mock device."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
