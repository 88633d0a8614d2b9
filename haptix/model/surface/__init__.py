"""The friction surface mu(F_N, V0, f, h0): build, evaluate, invert, save."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
