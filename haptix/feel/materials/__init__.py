"""Materials: the feel of a surface, as documents that answer for blocks of motion.

A `Material` is asked `wanted(motion)` and lists what it `depends_on`. `load` reads one from a file,
`KINDS` holds every kind by the name that documents use. ``docs/materials.md`` has them with
pictures, and how to make one of your own.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
