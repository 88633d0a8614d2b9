"""Noise of a given spectrum: random friction, the same for the same seed."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, PositiveFloat, field_serializer, model_validator
from pydantic.json_schema import SkipJsonSchema

from haptix.checks import Array, number, positive
from haptix.errors import InputError
from haptix.texture.field import FrictionField, turned
from haptix.texture.material import Material
from haptix.texture.pyramid import Beyond, Pyramid

Spectrum = Callable[[Array], Array]
"""Power density against wavenumber [1/mm], 0 or more, on any scale."""

_MOST_PIXELS = 4096**2


def power_law(exponent: float, shortest_mm: float, longest_mm: float) -> Spectrum:
    """Spectrum ``k^-exponent`` between two wavelengths, and 0 elsewhere.

    An exponent of 0 is white; 2 (1 + H) is that of a self-affine surface of Hurst exponent H in two
    dimensions, 1 + 2 H in one.

    Parameters
    ----------
    exponent : float
        How fast the power falls with the wavenumber.
    shortest_mm, longest_mm : float
        The two wavelengths [mm].

    Raises
    ------
    InputError
        If the wavelengths are not above 0 and increasing.

    Examples
    --------
    >>> density = power_law(2.0, shortest_mm=0.5, longest_mm=10.0)
    >>> density(np.array([1.0, 2.0, 4.0])).tolist()  # 4 per mm is shorter than 0.5 mm
    [1.0, 0.25, 0.0]
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


class Noise(FrictionField, Material):
    """Gaussian noise on a tile that repeats without a seam.

    Its spectrum is a power law, see `power_law`, or a function. Its tails are not cut off: 5 % of
    all places are more than two deviations from the mean. The renderer treats those outside the
    reachable range.

    Parameters
    ----------
    spectrum : callable, optional
        Power density against wavenumber [1/mm] in place of the power law; no document holds it. The
        wavenumber is the radial one of the plane, or with ``grain="ribbed"`` that along the
        direction.
    mean, deviation : float
        Mean of the friction, and how far it strays from it.
    target : {"share", "mu", "contrast"}
        What these are: shares of what the screen can reach, friction coefficients, or relative
        changes of friction.
    seed : int
        Same seed, same noise.
    tile_mm : float
        Side of the tile.
    pixels : int
        Pixels along it, a power of two.
    grain : {"isotropic", "ribbed"}
        Noise over the plane, or along one direction.
    orientation_deg : float
        Direction of the ribbed grain: 0 to the right, 90 down.
    exponent : float
        The power falls with the wavenumber to this power: 0 is white.
    shortest_mm, longest_mm : float
        Sizes of the smallest and of the largest unevenness: there is power between them.

    Raises
    ------
    InputError
        If a value is outside its range, or the spectrum has nothing between the tile and two
        pixels.

    Examples
    --------
    >>> rough = Noise(mean=0.5, deviation=0.1, seed=1)
    >>> rough.replace(seed=2) == rough
    False
    """

    kind: Literal["noise"] = "noise"
    spectrum: SkipJsonSchema[Spectrum | None] = None
    mean: float = 0.5
    deviation: PositiveFloat = 0.2
    target: Literal["share", "mu", "contrast"] = "share"
    seed: Annotated[int, Field(ge=0)] = 0
    tile_mm: PositiveFloat = 64.0
    pixels: Annotated[int, Field(ge=4, le=_MOST_PIXELS)] = 1024
    grain: Literal["isotropic", "ribbed"] = "isotropic"
    orientation_deg: float = 0.0
    exponent: float = 2.0
    shortest_mm: PositiveFloat = 0.5
    longest_mm: PositiveFloat = 10.0

    @model_validator(mode="after")
    def _is_possible(self) -> Self:
        rows = self._rows
        if self.pixels & (self.pixels - 1) or rows * self.pixels > _MOST_PIXELS:
            raise ValueError(
                f"expected pixels that are a power of two, and at most {_MOST_PIXELS} in all, got "
                f"{rows} x {self.pixels}"
            )
        self._density(1)
        return self

    @field_serializer("spectrum")
    def _written(self, spectrum: Spectrum | None) -> None:
        if spectrum is not None:
            raise ValueError(
                "noise: a spectrum that is a function cannot be written; give exponent, "
                "shortest_mm and longest_mm"
            )

    @property
    def evaluator(self) -> Self:
        """Itself, with its tile computed."""
        _ = self._pyramid
        return self

    @property
    def _rows(self) -> int:
        return self.pixels if self.grain == "isotropic" else 1

    @cached_property
    def _pyramid(self) -> Pyramid:
        tile = self.mean + self.deviation * self._tile(self._rows)
        beyond_y: Beyond = "repeat" if self.grain == "isotropic" else "hold"
        return Pyramid(tile, self.tile_mm / self.pixels, self.mean, "repeat", beyond_y)

    def _density(self, rows: int) -> Array:
        """Density of the spectrum on a tile's wavenumbers, shape (rows, pixels / 2 + 1)."""
        pixel = self.tile_mm / self.pixels
        across = np.fft.rfftfreq(self.pixels, pixel)
        k = np.hypot(np.fft.fftfreq(rows, pixel)[:, None], across)
        spectrum = self.spectrum or power_law(self.exponent, self.shortest_mm, self.longest_mm)
        density = np.broadcast_to(np.asarray(spectrum(k), dtype=np.float64), k.shape).copy()
        density[0, 0] = 0.0  # the field `mean` sets the mean
        if not (np.isfinite(density).all() and (density >= 0).all() and density.any()):
            raise InputError(
                "spectrum: expected finite densities of 0 or more, and some above 0 for waves from "
                f"{2 * pixel:g} to {self.tile_mm:g} mm"
            )
        return density

    def _tile(self, rows: int) -> Array:
        """Noise of mean 0 and deviation 1, shape (rows, pixels)."""
        density = self._density(rows)
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
