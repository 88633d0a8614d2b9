"""Spectra of measured surfaces: height maps and line scans, whose power is kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi, sqrt
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt
import torch

from haptix.base import checks
from haptix.base.errors import InputError
from haptix.model.contact.power_laws import PowerLaws

Array = npt.NDArray[np.float64]
Removed = Literal["mean", "plane", "radius", "form"]

_RINGS_PER_DECADE = 10  # over which the spectrum of a map is averaged
_LEAST_POWER = 1e-12  # of a ring, as a share of the whole: a spectrum has no empty rings
_DEGREES: dict[str, int] = {"mean": 0, "plane": 1, "radius": 2, "form": 4}
_MOST_MISSING = (
    0.05  # of a map: filled points hold no roughness, which lowers the slope by half this
)
_HIGHEST_M = 0.1  # of skin: larger numbers are in another unit, or mark missing points
_MOST_UNEQUAL = 1.5  # sides of pixels
_FORM_SHARE = 0.5  # of the mean square that a radius must explain to be told


@dataclass(frozen=True)
class MeasuredSurface:
    """Heights of a map, or of line scans of one surface.

    Parameters
    ----------
    heights_m : tuple of ndarray
        One map of shape (rows, columns), or line scans of one axis each; NaN where a point is
        missing.
    pixel_m : tuple of float
        Distance between rows and between columns, or the one between the points of each scan.
    is_periodic : bool
        Whether the surface goes on at its borders as it began.
    notes : tuple of str
        How the heights were read.
    """

    heights_m: tuple[Array, ...]
    pixel_m: tuple[float, ...]
    is_periodic: bool = False
    notes: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        height_m: Any,
        pixel_m: float | Sequence[float] | None = None,
        is_periodic: bool | None = None,
    ) -> MeasuredSurface:
        """Take an array of heights [m], or objects of SurfaceTopography's kinds.

        Parameters
        ----------
        height_m, pixel_m, is_periodic
            As for `RoughnessSpectrum.from_topography`.

        Raises
        ------
        InputError
            If unit or pixels are not known, or the heights are none of a surface.
        """
        several = isinstance(height_m, list | tuple) and len(height_m) > 0
        kinds = (np.ndarray, torch.Tensor)
        scans = several and all(isinstance(one, kinds) and one.ndim == 1 for one in height_m)
        parts = list(height_m) if several and hasattr(height_m[0], "unit") else [height_m]
        if scans:
            surface = cls.together([_of_array(scan, pixel_m) for scan in height_m])
        elif not hasattr(parts[0], "unit"):
            surface = _of_array(height_m, pixel_m)
        elif pixel_m is not None:
            raise InputError(f"pixel_m: a topography brings its own pixels, got {pixel_m} too")
        else:
            surface = cls.together([_of_topography(part) for part in parts])
        return surface if is_periodic is None else replace(surface, is_periodic=is_periodic)

    @classmethod
    def together(cls, surfaces: Sequence[MeasuredSurface]) -> MeasuredSurface:
        """Take line scans of one surface together; a map stays alone.

        Raises
        ------
        InputError
            If there are several maps.
        """
        if len(surfaces) > 1 and any(surface.is_map for surface in surfaces):
            raise InputError("height_m: expected one map, or line scans alone, got several maps")
        return cls(
            tuple(part for surface in surfaces for part in surface.heights_m),
            tuple(side for surface in surfaces for side in surface.pixel_m),
            all(surface.is_periodic for surface in surfaces),
            tuple(dict.fromkeys(note for surface in surfaces for note in surface.notes)),
        )

    @classmethod
    def of_line(cls, x_m: Array, height_m: Array) -> MeasuredSurface:
        """Take a line scan of heights [m] at places [m], even or not."""
        return _evenly(x_m, height_m)

    @property
    def is_map(self) -> bool:
        """Whether it is a map, and no line scans."""
        return self.heights_m[0].ndim == 2

    def spectrum(self, remove: Removed | None = None) -> tuple[PowerLaws, tuple[str, ...]]:
        """Return the spectrum, which has the mean squares of heights and slope, and its notes.

        Parameters
        ----------
        remove
            As for `RoughnessSpectrum.from_topography`.

        Raises
        ------
        InputError
            If the surface is flat, or too much of it is missing.
        """
        if remove not in (None, *get_args(Removed)):
            raise InputError(f"remove: expected one of {', '.join(_DEGREES)}, got {remove!r:.40}")
        remove = remove or ("mean" if self.is_periodic else "plane")
        pixels = [self.pixel_m] if self.is_map else [(pixel,) for pixel in self.pixel_m]
        flat = [_levelled(height, remove) for height in self.heights_m]
        waves = [
            _waves(part.heights_m, pixel, self.is_periodic)
            for part, pixel in zip(flat, pixels, strict=True)
        ]
        side = max(
            n * d
            for h, p in zip(self.heights_m, pixels, strict=True)
            for n, d in zip(h.shape, p, strict=True)
        )
        low, high = 2 * pi / side, pi / max(self.pixel_m)
        edges = _ring_edges(low, high)
        q = np.concatenate([part[0] for part in waves])
        power = np.concatenate([part[1] for part in waves]) / len(waves)
        # The shortest waves of a map are seen across its corners alone, so C is not known there.
        # They are left out, and their share of the mean square, which is small, goes to the rest.
        seen = q <= edges[-1]
        q, power = q[seen], power[seen] * (power.sum() / power[seen].sum())
        ring = np.clip(np.digitize(q, edges) - 1, 0, len(edges) - 2)
        height2: Array = np.bincount(ring, power, len(edges) - 1).astype(float)
        slope2: Array = np.bincount(ring, power * q**2, len(edges) - 1).astype(float)
        count = np.bincount(ring, minlength=len(edges) - 1)
        wanted = float(slope2.sum()) if self.is_map else None
        if not self.is_map:
            # Each wave of a scan stands for those from half a wave a side below to half above it.
            first = np.ceil(edges / low - 1e-6) - 0.5
            rings = _of_all_directions(edges, height2, first * low)
            height2 = rings * (height2.sum() / rings.sum())  # a scan's mean square is the surface's
            slope2 = height2 * edges[1:] * edges[:-1]
        notes = [*self.notes, *dict.fromkeys(note for part in flat for note in part.notes)]
        notes.append("no window, since it is periodic" if self.is_periodic else "Hann window")
        if not self.is_map:
            notes.append(f"{len(flat)} line scans, taken as those of an isotropic surface")
        return _from_rings(edges, height2, slope2, count > 0, wanted), tuple(notes)


def _of_topography(topography: Any) -> MeasuredSurface:
    """Read an object of SurfaceTopography's kinds, with its unit, pixels and period."""
    if topography.unit is None:
        raise InputError(
            "height_m: expected a topography whose unit is known; give it one, such as unit='um'"
        )
    in_metres = topography.to_unit("m")
    if topography.dim == 1 and not topography.is_uniform:
        return _evenly(*(np.asarray(part) for part in in_metres.positions_and_heights()))
    surface = _of_array(in_metres.heights(), tuple(float(side) for side in in_metres.pixel_size))
    return MeasuredSurface(surface.heights_m, surface.pixel_m, bool(topography.is_periodic))


def _evenly(x_m: Array, height_m: Array) -> MeasuredSurface:
    """Put a line scan of uneven steps onto even ones, by straight lines between its points."""
    there = np.isfinite(x_m) & np.isfinite(height_m)
    order = np.argsort(x_m[there], kind="stable")
    x, height = x_m[there][order], height_m[there][order]
    if len(x) < 8 or not (np.diff(x) > 0).all():
        raise InputError(
            "height_m: expected a line scan of 8 points or more, each at a place of its own; drop "
            "repeated and overhanging points"
        )
    even = np.linspace(x[0], x[-1], len(x))
    steps = np.diff(x)
    uneven = float(steps.max() / steps.mean())
    note = f"line scan with steps up to {steps.max():.3g} m, put onto steps of {steps.mean():.3g} m"
    surface = _of_array(np.interp(even, x, height), float(steps.mean()))
    return MeasuredSurface(surface.heights_m, surface.pixel_m, notes=(note,) * (uneven > 1.001))


def _of_array(height_m: Any, pixel_m: float | Sequence[float] | None) -> MeasuredSurface:
    """Check heights and pixels; masked and infinite points become NaN."""
    try:
        height: Array = np.ma.filled(np.ma.asarray(height_m, dtype=float), np.nan)
    except (TypeError, ValueError):
        raise InputError("height_m: expected a map or a line scan of numbers [m]") from None
    if pixel_m is None:
        raise InputError("pixel_m: expected the distance between pixels [m], got None")
    pixels = tuple(np.broadcast_to(np.asarray(pixel_m, dtype=float), (height.ndim,)).tolist())
    for side in pixels:
        checks.positive("pixel_m", side)
    if height.ndim not in (1, 2) or min(height.shape) < 8:
        raise InputError(
            "height_m: expected a map of at least 8 x 8 pixels, or a line scan of 8 points, "
            f"got shape {height.shape}"
        )
    if max(pixels) > _MOST_UNEQUAL * min(pixels):
        raise InputError(
            f"height_m: expected square pixels, or nearly so, got {pixels} m; pass the rows as "
            "line scans"
        )
    height[~np.isfinite(height)] = np.nan
    if np.isnan(height).all():
        raise InputError("height_m: expected heights, but all points are missing")
    highest = float(np.nanmax(np.abs(height - np.nanmedian(height))))
    if highest > _HIGHEST_M:
        raise InputError(
            f"height_m: expected heights [m] of skin, got some that differ by {highest:.3g} m; "
            "give them in metres, and mask what stands for missing points"
        )
    return MeasuredSurface((height,), pixels)


@dataclass(frozen=True)
class _Levelled:
    heights_m: Array
    notes: tuple[str, ...]


def _levelled(height: Array, remove: Removed) -> _Levelled:
    """Fill missing points, and take a polynomial away."""
    missing = np.isnan(height)
    share, notes = float(missing.mean()), []
    if share > _MOST_MISSING:
        raise InputError(
            f"height_m: {share:.1%} of the points are missing, and at most {_MOST_MISSING:.0%} can "
            "be filled; crop the map to a part that is whole, or fill it with the instrument's own "
            "software"
        )
    if share:
        notes.append(f"{share:.2g} of the points were missing and filled from their neighbours")
    axes = [np.linspace(-1, 1, size) for size in height.shape]
    places = [axis[~missing] for axis in np.meshgrid(*axes, indexing="ij")]
    there = height[~missing]

    def rest(degree: int, axes: Sequence[Array] = tuple(places)) -> Array:
        powers = [p for p in np.ndindex(*(degree + 1,) * height.ndim) if sum(p) <= degree]
        terms = np.stack(
            [np.prod([a**n for a, n in zip(axes, p, strict=True)], axis=0) for p in powers], -1
        )
        # By the normal equations, whose terms are few and of order 1: maps have millions of points.
        wanted = np.linalg.lstsq(terms.T @ terms, terms.T @ there, rcond=None)[0]
        return np.asarray(there - terms @ wanted)

    whole, level = rest(0), rest(_DEGREES[remove])
    if np.ptp(there) == 0 or level.std() <= 1e-9 * np.abs(there).max():
        raise InputError("height_m: expected some roughness, got a flat map")
    if _DEGREES[remove]:
        gone = sqrt(max(float((whole**2).mean() - (level**2).mean()), 0.0))
        notes.append(f"{remove} removed, {gone:.3g} m rms of it{_COSTS[remove]}")
    if _DEGREES[remove] < 2:
        rounded = rest(2)
        if 1 - (rounded**2).mean() / (level**2).mean() > _FORM_SHARE:
            notes.append(
                f"warning: a radius makes up {level.std():.3g} m of its roughness, which is "
                f"{rounded.std():.3g} m without; if that is the form of the finger, remove it "
                '(remove="radius")'
            )
    filled = np.zeros_like(height)
    filled[~missing] = level
    if share:
        filled[missing] = _from_neighbours(filled, missing)
    return _Levelled(filled * (level.std() / filled.std()), tuple(notes))


_COSTS = {
    "plane": "",
    # A polynomial of n terms takes as much as the n longest waves, up to sqrt(n/pi) 2 pi/side.
    "radius": ", and with it waves longer than 0.7 times the side",
    "form": ", and with it waves longer than 0.45 times the side",
}


def _from_neighbours(height: Array, missing: npt.NDArray[np.bool_]) -> Array:
    """Interpolate missing points between the nearest ones that are there."""
    from scipy.interpolate import griddata
    from scipy.ndimage import binary_dilation

    beside = binary_dilation(missing, iterations=2) & ~missing
    known, wanted = np.argwhere(beside), np.argwhere(missing)
    if height.ndim == 1:
        return np.asarray(np.interp(wanted[:, 0], known[:, 0], height[beside]))
    filled = griddata(known, height[beside], wanted, "linear")
    outside = np.isnan(filled)
    if outside.any():
        filled[outside] = griddata(known, height[beside], wanted[outside], "nearest")
    return np.asarray(filled)


def _waves(height: Array, pixel: Sequence[float], is_periodic: bool) -> tuple[Array, Array]:
    """Wavenumbers [1/m] and mean squares [m^2] of the waves, which sum to that of the heights."""
    window = np.ones(height.shape)
    if not is_periodic:
        for axis, size in enumerate(height.shape):
            window *= np.hanning(size).reshape([-1 if a == axis else 1 for a in range(height.ndim)])
    windowed = (height - (window * height).sum() / window.sum()) * window
    power = np.abs(np.fft.fftn(windowed)).ravel() ** 2
    grid = np.meshgrid(
        *(2 * pi * np.fft.fftfreq(n, d) for n, d in zip(height.shape, pixel, strict=True)),
        indexing="ij",
    )
    q = np.sqrt(sum(axis**2 for axis in grid)).ravel()
    power[q == 0] = 0.0
    there = q > 0
    return q[there], power[there] * (float((height**2).mean()) / power.sum())


def _ring_edges(low: float, high: float) -> Array:
    count = max(3, round(_RINGS_PER_DECADE * np.log10(high / low)))
    # A little wider than the band: rounding must not leave out the waves at its ends.
    return np.geomspace(low * (1 - 1e-9), high * (1 + 1e-9), count + 1)


def _of_all_directions(edges: Array, along: Array, ends: Array) -> Array:
    """Mean squares by ring of the isotropic surface whose line scans have `along` between `ends`.

    A ring of waves q in all directions has the waves ``q cos(angle)`` along a line, most of them
    near q. Their shares are inverted by the iteration of Richardson (J. Opt. Soc. Am. 62, 55, 1972)
    and Lucy, which stays positive. The rings hold more than `along`: what they have along a line
    below its first end is in none of its waves.
    """
    # Shares of ring j that a line shows in ring i, averaged over the ring.
    inside = edges[:-1, None] ** (1 - _WITHIN) * edges[1:, None] ** _WITHIN
    turn = np.arcsin(np.minimum(ends[:, None, None] / inside[None], 1.0)) * 2 / pi
    shown = np.diff(turn, axis=0).mean(-1)
    rings = np.maximum(along, _LEAST_POWER * along.sum())
    wanted = rings
    for _ in range(_LUCY_ROUNDS):
        rings = rings * (shown.T @ (wanted / np.maximum(shown @ rings, 1e-300))) / shown.sum(0)
    return np.asarray(rings)


_LUCY_ROUNDS = 30  # more would turn the scatter of few scans into single waves


def of_line_spectrum(line: PowerLaws) -> PowerLaws:
    """Return the isotropic surface whose line scans have a spectrum C_1D [m^3]."""
    edges = _ring_edges(line.q0, line.q1)
    ends = torch.from_numpy(edges).clamp(line.q0, line.q1)
    along = -line.moment(0, ends).diff().numpy() / (2 * pi**2)  # C_1D dq / pi
    height2 = _of_all_directions(edges, along, edges)
    every = np.ones(len(along), dtype=bool)
    return _from_rings(edges, height2, height2 * edges[1:] * edges[:-1], every, None)


def over_rings(spectrum: PowerLaws) -> PowerLaws:
    """Return a spectrum of few nodes that has the power of one of many."""
    spectrum = PowerLaws(spectrum.wavenumber.detach(), spectrum.density.detach())
    edges = _ring_edges(spectrum.q0, spectrum.q1)
    ends = torch.from_numpy(edges).clamp(spectrum.q0, spectrum.q1)
    height2, slope2 = (-spectrum.moment(power, ends).diff().numpy() for power in (1, 3))
    every = np.ones(len(height2), dtype=bool)
    return _from_rings(edges, height2, slope2, every, float(slope2.sum()))


_WITHIN = (np.arange(8) + 0.5) / 8  # places within a ring


def _from_rings(
    edges: Array,
    height2: Array,
    slope2: Array,
    has_waves: npt.NDArray[np.bool_],
    wanted_slope2: float | None,
) -> PowerLaws:
    """Return the spectrum whose rings between `edges` have given mean squares of heights.

    Between the nodes, one a ring, it is a power law; the nodes' densities are found by repeated
    division, and a power of q, nearly 0, brings the slope to its own mean square.
    """
    rings = np.flatnonzero(has_waves)
    total = float(height2.sum())
    power = np.maximum(height2[rings], _LEAST_POWER * total)
    middle = np.sqrt(edges[rings] * edges[rings + 1])
    heavy = height2[rings] > _LEAST_POWER * total
    nodes = np.where(heavy, np.sqrt(slope2[rings] / np.where(heavy, height2[rings], 1)), middle)
    nodes = np.clip(nodes, edges[rings] * 1.0001, edges[rings + 1] / 1.0001)
    nodes[0], nodes[-1] = edges[rings[0]], edges[rings[-1] + 1]
    q = torch.from_numpy(nodes)
    ends = torch.from_numpy(np.append(nodes[0], edges[rings + 1]))
    ends[-1] = nodes[-1]
    log_density = torch.from_numpy(np.log(power / (pi * np.diff(ends.numpy() ** 2))))
    wanted = torch.from_numpy(np.log(power))
    for _ in range(_MOST_ROUNDS):
        found = -PowerLaws(q, log_density.exp()).moment(1, ends).diff()
        change = wanted - torch.log(found)
        log_density = log_density + _STEP * change.clamp(-2.0, 2.0)
        if float(change.abs().max()) < 1e-9:
            break

    def tilted(power: float) -> PowerLaws:
        spectrum = PowerLaws(q, log_density.exp() * (q / q[-1]) ** power)
        return PowerLaws(q, spectrum.density * (total / float(spectrum.moment(1))))

    if wanted_slope2 is None:
        return tilted(0.0)
    from scipy.optimize import brentq

    def excess(power: float) -> float:
        return float(torch.log(tilted(power).moment(3))) - float(np.log(wanted_slope2))

    low, high = -_MOST_TILT, _MOST_TILT
    if not excess(low) < 0 < excess(high):
        return tilted(low if excess(low) > 0 else high)
    return tilted(brentq(excess, low, high, xtol=1e-13))


_MOST_ROUNDS, _STEP = 400, 0.7  # of dividing, damped; some 40 rounds are needed
_MOST_TILT = 0.5  # of the exponent; some 0.02 is needed
