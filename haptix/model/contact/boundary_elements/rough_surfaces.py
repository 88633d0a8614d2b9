"""Periodic rough surfaces on a grid: random from a spectrum, or a measured height map."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from math import ceil, isfinite, pi
from typing import Any

import numpy as np
import torch
from torch import Tensor

from haptix.base import checks
from haptix.base.display import Displayed
from haptix.base.errors import InputError
from haptix.model.contact.boundary_elements.bounded import wavenumbers
from haptix.model.contact.roughness import RoughnessSpectrum

# The shares in the messages: H = 0.8, x = p/(E* slope) = 1e-3 to 1e-1, against 32 pixels per
# shortest wavelength and against 16 roll-off wavelengths in the box, for the same total area.
_LEAST_PIXELS, _FINE_PIXELS = 2.0, 8.0
_LEAST_WAVES, _MANY_WAVES = 1.0, 4.0

_LEAST_POINTS = 16
# Of a measured map's mean-square slope: what lies at higher wavenumbers than the band is noise.
_SHARE_IN_BAND = 0.999
# A map whose borders do not meet has a jump there of many usual steps between neighbours.
_JUMP = 3.0


class ResolutionWarning(UserWarning):
    """The grid or the box is coarse enough to bias the results; the message has the bias."""


def check_resolution(pixels: float, waves: float, border_jump: float = 0.0) -> None:
    """Warn of or refuse a coarse grid, a small box and borders that do not meet."""
    rounding = 1 - 1e-9
    if pixels < _LEAST_PIXELS * rounding:
        raise InputError(
            f"points: expected 2 pixels or more per shortest wavelength, got {pixels:.3g}; add "
            "points, shrink the box, or cut the spectrum with q_high"
        )
    if waves < _LEAST_WAVES * rounding:
        raise InputError(
            "side_m: expected a box of at least one roll-off wavelength, got one of "
            f"{waves:.3g}; take a larger side_m"
        )
    biases = []
    if pixels < _FINE_PIXELS * rounding:
        biases.append(
            f"{pixels:.3g} pixels per shortest wavelength, 8 or more are advised: the raw area is "
            "some 5-15 % too large at 8, 10-20 % at 4 and 20-40 % at 2; the corrected area is off "
            "by up to 1, 4 and 7 %, the mean gap by up to 0.3 %"
        )
    if waves < _MANY_WAVES * rounding:
        biases.append(
            f"{waves:.3g} roll-off wavelengths in the box, 4 or more are advised: from surface "
            "to surface area and gap scatter by 3-20 % with 2 and 5-25 % with 1, and their means "
            "are off at light load (x = 1e-3), the area by +12 and +25 %, the gap by -5 and -14 %"
        )
    if border_jump:
        biases.append(
            f"opposite borders of the map differ by {border_jump:.3g} times the step between "
            "neighbours: the periodic solution has a step there; use mirrored=True"
        )
    for bias in biases:
        warnings.warn(bias, ResolutionWarning, stacklevel=3)


@dataclass(frozen=True)
class Surfaces(Displayed):
    """A batch of periodic square height maps, towards the solid that is pressed on them.

    Build one with `random` or `measured`.
    """

    height_m: Tensor
    """Heights [m], shape (surfaces, n, n), double precision, each with mean 0."""
    side_m: float
    """Length of the periodic box [m]."""
    q_low: float
    q_high: float
    """Lowest and highest wavenumber [1/m]."""
    waves_in_box: float
    """Number of roll-off wavelengths along a side: ``q_r side / 2 pi``."""

    @classmethod
    def random(
        cls,
        spectrum: RoughnessSpectrum,
        points: int,
        side_m: float | None = None,
        surfaces: int = 1,
        seed: int = 0,
        q_high: float | None = None,
    ) -> Surfaces:
        """Draw surfaces with the spectrum C(q), wave by wave with random phases.

        Every wave ``2 pi (i, j) / side`` in the band has exactly the mean square ``C(q) (2 pi /
        side)^2`` (Persson et al., J. Phys.: Condens. Matter 17, R1 (2005)). Surface i of a seed is
        the same on every grid, and however many are drawn with it. Raises `InputError` if a number
        is impossible, or the grid has less than 2 pixels per shortest wavelength, or the box less
        than one roll-off wavelength.

        Parameters
        ----------
        spectrum : RoughnessSpectrum
            C(q) [m^4]; outside its band there is no roughness.
        points : int
            Pixels along a side, n.
        side_m : float, optional
            Box [m]; by default the spectrum's longest wavelength.
        surfaces : int
            Number of surfaces.
        seed : int
            Seed of the phases, 0 or more.
        q_high : float, optional
            Cut the spectrum at this wavenumber [1/m]; by default its own end. To see what is
            missing, compare `slope_rms` with the spectrum's.

        Warns
        -----
        ResolutionWarning
            If the grid or the box is coarse enough to bias area or gap, with that bias.
        """
        checks.whole("points", points, _LEAST_POINTS)
        checks.whole("surfaces", surfaces, 1)
        checks.whole("seed", seed, 0)
        q_end = spectrum.q1 if q_high is None else min(q_high, spectrum.q1)
        checks.positive("q_high", q_end)
        side = 2 * pi / spectrum.q0 if side_m is None else float(side_m)
        checks.positive("side_m", side)
        if q_end <= spectrum.q0:
            raise InputError(
                f"q_high: expected a wavenumber above the spectrum's lowest, {spectrum.q0:g} /m, "
                f"got {q_end:g} /m"
            )
        waves_in_box = spectrum.q_rolloff * side / (2 * pi)
        check_resolution(2 * pi / q_end * points / side, waves_in_box)
        # A hair wider than the band, so that waves on its very ends count whatever the rounding.
        low, high = spectrum.q0 * (1 - 1e-9), q_end * (1 + 1e-9)
        block = 2 * (ceil(high * side / (2 * pi)) + 1)
        q = wavenumbers(block, side)
        inside = (q >= low) & (q <= high)
        within = q.clamp(spectrum.q0, q_end)
        amplitude = torch.where(inside, spectrum(within).detach().sqrt(), 0.0) * (2 * pi / side)
        height = torch.empty(surfaces, points, points, dtype=torch.float64)
        for i in range(surfaces):
            noise = np.random.default_rng([seed, i]).standard_normal((block, block))
            waves = torch.fft.rfft2(torch.from_numpy(noise)) / block
            height[i] = _on_grid(torch.polar(amplitude, waves.angle()), points)
        return cls(height, side, max(spectrum.q0, 2 * pi / side), q_end, waves_in_box)

    @classmethod
    def measured(cls, height_m: Any, pixel_m: float, mirrored: bool = False) -> Surfaces:
        """Take measured height maps, with the mean of each taken off.

        Raises `InputError` if the map is not square, not finite, flat or smaller than 16 by 16.

        Parameters
        ----------
        height_m : array_like, shape (n, n) or (surfaces, n, n)
            Heights [m].
        pixel_m : float
            Distance between pixels [m].
        mirrored : bool
            Reflect the map at its borders, to 2n by 2n: for maps that do not continue from one
            border to the other, as the periodic solution takes them to do.

        Warns
        -----
        ResolutionWarning
            As `random` does; the highest wavenumber is that below which 99.9 % of the mean-square
            slope lies. Also where opposite borders do not meet.
        """
        checks.positive("pixel_m", pixel_m)
        height = torch.as_tensor(np.asarray(height_m, dtype=float)).clone()
        if height.ndim == 2:
            height = height[None]
        if height.ndim != 3 or height.shape[1] != height.shape[2] or len(height) == 0:
            raise InputError(
                "height_m: expected a square map (n, n) or a batch of them, got shape "
                f"{tuple(np.shape(height_m))}; cut it to a square first"
            )
        if height.shape[1] < _LEAST_POINTS:
            raise InputError(
                f"height_m: expected at least {_LEAST_POINTS} pixels along a side, "
                f"got {height.shape[1]}"
            )
        if not bool(height.isfinite().all()):
            raise InputError("height_m: expected finite heights; fill missing points first")
        if bool((height.amax((-2, -1)) == height.amin((-2, -1))).any()):
            raise InputError("height_m: expected some roughness, got a flat map")
        if mirrored:
            height = torch.cat([height, height.flip(-1)], -1)
            height = torch.cat([height, height.flip(-2)], -2)
        height -= height.mean((-2, -1), keepdim=True)
        points = height.shape[-1]
        side = points * pixel_m
        q = wavenumbers(points, side)
        power = _power(height).mean(0)
        order = q.flatten().argsort()
        rising = q.flatten()[order]
        slope = (q**2 * power).flatten()[order].cumsum(0)
        roughness = power.flatten()[order].cumsum(0)
        at_share = int(torch.searchsorted(slope, _SHARE_IN_BAND * slope[-1]))
        q_high = float(rising[min(at_share, len(rising) - 1)])
        # Half of the mean square lies below this wavenumber.
        middle = float(rising[int(torch.searchsorted(roughness, roughness[-1] / 2))])
        waves_in_box = middle * side / (2 * pi)
        check_resolution(2 * pi / (q_high * pixel_m), waves_in_box, _border_jump(height))
        return cls(height, side, 2 * pi / side, q_high, waves_in_box)

    def __len__(self) -> int:
        return len(self.height_m)

    @property
    def points(self) -> int:
        """Pixels along a side."""
        return self.height_m.shape[-1]

    @property
    def pixel_m(self) -> float:
        """Distance between pixels [m]."""
        return self.side_m / self.points

    @property
    def pixels_per_shortest_wave(self) -> float:
        """Pixels per shortest wavelength."""
        return 2 * pi / (self.q_high * self.pixel_m)

    @property
    def h_rms_m(self) -> Tensor:
        """Root-mean-square height achieved [m], shape (surfaces,)."""
        return self.height_m.square().mean((-2, -1)).sqrt()

    @property
    def slope_rms(self) -> Tensor:
        """Root-mean-square slope achieved, shape (surfaces,): of the waves, not between pixels."""
        q = wavenumbers(self.points, self.side_m)
        return torch.stack([(q**2 * _power(h)).sum().sqrt() for h in self.height_m])


def _on_grid(waves: Tensor, points: int) -> Tensor:
    """Heights on `points` x `points` pixels of waves given on a block of their own."""
    block = waves.shape[-2]
    half = min(block, points) // 2
    placed = waves.new_zeros(points, points // 2 + 1)
    placed[:half, :half] = waves[:half, :half]
    placed[-half + 1 :, :half] = waves[-half + 1 :, :half]
    height: Tensor = torch.fft.irfft2(placed, s=(points, points)) * points**2
    return height


def _power(height: Tensor) -> Tensor:
    """Mean square of each wave of the half spectrum, both of its halves counted."""
    points = height.shape[-1]
    power: Tensor = (torch.fft.rfft2(height) / points**2).abs() ** 2
    last = -1 if points % 2 == 0 else None
    power[..., 1:last] *= 2
    return power


def _border_jump(height: Tensor) -> float:
    """Rms step from border to border over that between neighbours, the larger of two directions."""
    jumps = []
    for axis in (-2, -1):
        inside = height.diff(dim=axis).square().mean().sqrt()
        across = (height.select(axis, 0) - height.select(axis, -1)).square().mean().sqrt()
        jumps.append(float(across / inside))
    worst = max(jumps)
    return worst if isfinite(worst) and worst > _JUMP else 0.0
