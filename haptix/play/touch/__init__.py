"""Touch: from a touchscreen's reports to the finger's place and normal force now."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
