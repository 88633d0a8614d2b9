"""All that a finger can feel: signals, materials, layouts, and how fingers move."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
