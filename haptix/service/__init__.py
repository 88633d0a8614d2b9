"""A local service: any app, in any language, on this machine; see `haptix serve`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
