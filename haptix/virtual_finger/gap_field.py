"""Places in the gap at which the squared field is followed, for any voltage.

A gap u divides a voltage with the insulators frequency by frequency, ``E(f) = V(f)/(u + h0(f))``.
Its attraction is proportional to the square of their sum in time. With a real length h near the
insulators' own, and ``s = h/(u + h)``, which runs from 0 in wide gaps to 1 at a contact spot,

    E = F^-1[ V(f) / (1 + d(f) s) ] / (u + h),    d(f) = h0(f)/h - 1.

What is left under the transform is smooth in s: a polynomial through its squares at a few Chebyshev
points holds it for all gaps, and without dispersion (d = 0) a single point is exact. Where the
insulators span decades, as in a leaking gap, the polynomial is in ``ln(u + |h0|)`` instead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numpy.polynomial.chebyshev import chebpts1, chebvander

from haptix.checks import Array
from haptix.errors import InputError

ComplexArray = npt.NDArray[np.complex128]
Thickness = Callable[[Array], ComplexArray]
"""Complex h0 [m] at frequencies [Hz] from 0."""

_TOLERANCE = 1e-4  # of the attraction on any gap: about a thousandth of a JND
_COUNTS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 40, 48, 64, 96, 128)
_TESTED = 200  # gaps at which the polynomial is compared
_BANDS_PER_OCTAVE = 8
_WELCH = 1 << 16  # samples of one spectrum
_EMPTY = 1e-12  # of the largest energy: rounding of the transform


@dataclass(frozen=True)
class GapField:
    """Chebyshev points in the gap.

    Parameters
    ----------
    reference_m : float
        h [m].
    points : int
        Number of points.
    span_m : (float, float), optional
        Thinnest insulator and widest gap [m] between which the points are even in
        ``ln(u + thinnest)``; without it they are even in s.
    """

    reference_m: float
    points: int
    span_m: tuple[float, float] | None = None

    @classmethod
    def for_drive(
        cls, drive_v: Array, sample_rate_hz: float, thickness_m: Thickness, widest_gap_m: float
    ) -> GapField:
        """Choose the points for this drive's attraction, see `for_bands`."""
        from scipy.signal import welch  # a second of every start of the live finger

        length = min(_WELCH, len(drive_v))
        # Include the silence around it: switching on and off is part of the drive.
        drive_v = np.pad(drive_v, length // 2)
        frequency, energy = welch(
            drive_v, sample_rate_hz, "boxcar", length, detrend=False, scaling="spectrum"
        )
        thickness = thickness_m(frequency)
        attraction = energy / np.abs(thickness) ** 2
        if not attraction.any():
            return cls(1.0, 1)
        strongest, weight = _by_band(frequency, attraction)
        return cls.for_bands(thickness[strongest], weight, widest_gap_m)

    @classmethod
    def for_bands(
        cls, thickness_m: ComplexArray, attraction: Array, widest_gap_m: float
    ) -> GapField:
        """Choose h and the fewest points that hold the attraction on every gap within 1e-4.

        Parameters
        ----------
        thickness_m : ndarray of complex, shape (bands,)
            h0 [m] of each band of frequencies.
        attraction : ndarray, shape (bands,)
            Attraction of each band in a contact spot, in any unit.
        widest_gap_m : float
            Widest gap [m].

        Raises
        ------
        InputError
            If the insulators differ too much between the bands.
        """
        size = np.abs(thickness_m)
        reference, thinnest = float((attraction * size).sum() / attraction.sum()), float(size.min())
        for count in _COUNTS:
            for span in (None, (thinnest, widest_gap_m)):
                field = cls(reference, count, span)
                if field._error(thickness_m, attraction, widest_gap_m) <= _TOLERANCE:
                    return field
        raise InputError(
            "drive_v: expected frequencies that meet similar insulators, got ones between "
            f"{thinnest:.3g} and {size.max():.3g} m; remove what the drive has near 0 Hz"
        )

    @property
    def share(self) -> Array:
        """Return s at each point."""
        even = np.asarray((1 + chebpts1(self.points)) / 2)
        if self.span_m is None:
            return even
        thinnest, widest = self.span_m
        gap = thinnest * np.expm1(even * np.log1p(widest / thinnest))
        return np.asarray(self.reference_m / (gap + self.reference_m))

    def basis_of_gaps(self, gap_m: Array) -> Array:
        """Weight of each point's value in gaps [m], shape (points, gaps)."""
        if self.span_m is None:
            place = self.reference_m / (gap_m + self.reference_m)
        else:
            thinnest, widest = self.span_m
            place = (np.log1p(gap_m / thinnest) / np.log1p(widest / thinnest)).clip(max=1.0)
        at_points = chebvander(chebpts1(self.points), self.points - 1)
        return np.asarray(
            np.linalg.solve(at_points.T, chebvander(2 * place - 1, self.points - 1).T)
        )

    def _error(self, thickness_m: ComplexArray, attraction: Array, widest_gap_m: float) -> float:
        """Largest error of the attraction on any gap, relative to the attraction there."""
        finest = 1e-2 * float(np.abs(thickness_m).min())
        gap = np.append(0.0, np.geomspace(finest, widest_gap_m, _TESTED))
        excess = thickness_m[:, None] / self.reference_m - 1
        exact = 1 / (1 + excess * (self.reference_m / (gap + self.reference_m))) ** 2
        lack = np.abs((1 / (1 + excess * self.share) ** 2) @ self.basis_of_gaps(gap) / exact - 1)
        h0 = thickness_m[:, None]
        there = attraction[:, None] * np.abs(h0 / (gap + h0)) ** 2
        # A weak frequency attracts by its product with a strong one: its amplitude counts.
        return float((np.sqrt(there / there.sum(axis=0)) * lack).max())


def _by_band(frequency: Array, attraction: Array) -> tuple[npt.NDArray[np.int64], Array]:
    """Index of the strongest frequency, and sum of the attraction, of each band not empty."""
    octave = np.log2(np.maximum(frequency, frequency[1] / 2) / frequency[1])
    band = np.floor(octave * _BANDS_PER_OCTAVE).astype(int)
    first = np.flatnonzero(np.diff(band, prepend=band[0] - 1))
    total = np.add.reduceat(attraction, first)
    parts = np.split(attraction, first[1:])
    strongest = first + np.array([part.argmax() for part in parts])
    used = total > _EMPTY * total.max()
    return strongest[used], total[used]
