"""Sensing: an unknown finger, known by the current that it draws.

Experimental: no driver has a sensor yet, and all fingers that it learned were simulated.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
