"""Layouts: materials in regions of the screen that come, move and go while they are felt."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
