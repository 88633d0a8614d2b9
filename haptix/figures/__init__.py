"""The figures of the paper and of the model's foundations, as numbers and as drawings.

Each figure is a function that returns its `FigureData`; `write_figures` draws them all.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
