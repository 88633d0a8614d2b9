"""Noise of a given spectrum: random friction, the same for the same seed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from haptix.checks import Array, Positive, check_fields, choice, number, positive, whole
from haptix.errors import InputError
from haptix.texture.field import FrictionField, TargetKind, check_target, turned
from haptix.texture.pyramid import Beyond, Pyramid

Spectrum = Callable[[Array], Array]
"""Power density against wavenumber [1/mm], 0 or more, on any scale."""

_MOST_PIXELS = 4096**2


def power_law(exponent: float, shortest_mm: float, longest_mm: float) -> Spectrum:
    """Spectrum ``k^-exponent`` between two wavelengths, and 0 elsewhere.

    An exponent of 0 is white; 2 (1 + H) is that of a self-affine surface of Hurst exponent H in two
    dimensions, 1 + 2 H in one.

    Raises
    ------
    InputError
        If the wavelengths are not above 0 and increasing.
    """
    number("exponent", exponent)
    if not positive("shortest_mm", shortest_mm) < positive("longest_mm", longest_mm):
        raise InputError(
            f"power_law: expected 0 < shortest_mm < longest_mm, got {shortest_mm:g}, {longest_mm:g}"
        )

    def density(k: Array) -> Array:
        inside = (k >= 1 / longest_mm) & (k <= 1 / shortest_mm)
        return np.where(inside, np.where(inside, k, 1.0) ** -exponent, 0.0)

    return density


@dataclass(frozen=True)
class Noise(FrictionField):
    """Gaussian noise on a tile that repeats without a seam.

    Its tails are not cut off: 5 % of all places are more than two deviations from the mean. The
    renderer treats those outside the reachable range.

    Parameters
    ----------
    spectrum : callable
        Power density against wavenumber [1/mm], such as `power_law`. The wavenumber is the radial
        one of the plane, or with ``grain="ribbed"`` that along the direction.
    mean, deviation : float
        Mean of the values, and their standard deviation over the tile.
    target : {"mu", "contrast", "share"}
        What the values are, see `haptix.texture.as_mu`.
    seed : int
        Same seed, same noise.
    tile_mm : float
        Side of the tile.
    pixels : int
        Pixels along the tile's side, a power of two.
    grain : {"isotropic", "ribbed"}
        Noise over the plane, or along one direction with ridges across.
    orientation_deg : float
        That direction: 0 to the right, 90 down.

    Raises
    ------
    InputError
        If a value is outside its range, or the spectrum has nothing between the tile and two
        pixels.
    """

    spectrum: Spectrum
    mean: float = 0.5
    deviation: Positive = 0.2
    target: TargetKind = "share"
    seed: int = 0
    tile_mm: Positive = 64.0
    pixels: int = 1024
    grain: Literal["isotropic", "ribbed"] = "isotropic"
    orientation_deg: float = 0.0
    _pyramid: Pyramid = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_target(self.target)
        check_fields(self)
        if not callable(self.spectrum):
            raise InputError(
                "spectrum: expected a function of the wavenumber such as power_law(...), got "
                f"{self.spectrum!r:.80}"
            )
        whole("seed", self.seed)
        whole("pixels", self.pixels, 4)
        choice("grain", self.grain, ("isotropic", "ribbed"))
        rows = self.pixels if self.grain == "isotropic" else 1
        two = self.pixels & (self.pixels - 1) == 0
        if not two or rows * self.pixels > _MOST_PIXELS:
            raise InputError(
                f"pixels: expected a power of two, and at most {_MOST_PIXELS} pixels in "
                f"all, got {rows} x {self.pixels}"
            )
        tile = self.mean + self.deviation * self._tile(rows)
        beyond_y: Beyond = "repeat" if self.grain == "isotropic" else "hold"
        pyramid = Pyramid(tile, self.tile_mm / self.pixels, self.mean, "repeat", beyond_y)
        object.__setattr__(self, "_pyramid", pyramid)

    def _tile(self, rows: int) -> Array:
        """Noise of mean 0 and deviation 1, shape (rows, pixels)."""
        pixel = self.tile_mm / self.pixels
        across = np.fft.rfftfreq(self.pixels, pixel)
        k = np.hypot(np.fft.fftfreq(rows, pixel)[:, None], across)
        density = np.broadcast_to(np.asarray(self.spectrum(k), dtype=np.float64), k.shape).copy()
        density[0, 0] = 0.0  # the mean is given
        if not (np.isfinite(density).all() and (density >= 0).all() and density.any()):
            raise InputError(
                "spectrum: expected finite densities of 0 or more, and some above 0 for waves from "
                f"{2 * pixel:g} to {self.tile_mm:g} mm"
            )
        white = np.random.default_rng(self.seed).standard_normal((rows, self.pixels))
        noise = np.fft.irfft2(np.fft.rfft2(white) * np.sqrt(density), s=white.shape)
        return np.asarray(noise / noise.std())

    @property
    def outside(self) -> float:
        """The mean."""
        return self.mean

    def _sample(self, x_mm: Array, y_mm: Array, footprint_mm: float | Array) -> Array:
        x_mm, y_mm = turned(x_mm, y_mm, self.orientation_deg)
        return self._pyramid.sample(x_mm, y_mm, footprint_mm)
