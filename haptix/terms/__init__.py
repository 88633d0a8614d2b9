"""The terms of the contact model: effects that can be switched on and off by name, one a file."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
