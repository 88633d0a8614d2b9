"""Offline stimuli: signals, sets, files, and the methods that choose among them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
