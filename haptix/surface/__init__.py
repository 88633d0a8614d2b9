"""The friction surface mu(F_N, V0, f, h0): build, evaluate, invert, save."""

from haptix.surface.build import build_surface, surface_key
from haptix.surface.cache import cached_surface
from haptix.surface.surface import FrictionSurface, Inversion, SurfaceSample

__all__ = [
    "FrictionSurface",
    "Inversion",
    "SurfaceSample",
    "build_surface",
    "cached_surface",
    "surface_key",
]
