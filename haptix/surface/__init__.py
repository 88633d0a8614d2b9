"""The friction surface mu(F_N, V0, f, h0): build, evaluate, invert, save."""

from haptix.surface.boundary_elements import MeasuredPoints, MeasuringJob
from haptix.surface.cache import cached_surface
from haptix.surface.column import PULL_IN_DRIVE, PULL_IN_SHARE, Column
from haptix.surface.identity import surface_key
from haptix.surface.interpolant import Interpolant
from haptix.surface.slice import Slice
from haptix.surface.surface import FrictionSurface, Inversion, SurfaceSample
from haptix.surface.tolerance import LARGEST_BYTES, Tolerance

__all__ = [
    "LARGEST_BYTES",
    "PULL_IN_DRIVE",
    "PULL_IN_SHARE",
    "Column",
    "FrictionSurface",
    "Interpolant",
    "Inversion",
    "MeasuredPoints",
    "MeasuringJob",
    "Slice",
    "SurfaceSample",
    "Tolerance",
    "cached_surface",
    "surface_key",
]
