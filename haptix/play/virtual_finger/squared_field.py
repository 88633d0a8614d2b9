"""The squared field that a played voltage makes in gaps, at a few points in them.

A gap u divides a voltage with the insulators frequency by frequency, ``E(f) = V(f)/(u + h0(f))``.
Its attraction is proportional to the square of their sum in time. With a real length h near the
insulators' own, and ``s = h/(u + h)``, which runs from 0 in wide gaps to 1 at a contact spot,

    E = F^-1[ V(f) / (1 + d(f) s) ] / (u + h),    d(f) = h0(f)/h - 1.

The rest under the transform is smooth in s: a polynomial through its squares at a few Chebyshev
points gives it for all gaps; without dispersion (d = 0) a single point is exact. Where the
insulators span decades, as in a leaking gap, the polynomial is in ``ln(u + |h0|)`` instead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil

import numpy as np
import numpy.typing as npt
from numpy.polynomial.chebyshev import chebpts1, chebvander
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq

from haptix.base.checks import Array
from haptix.base.errors import InputError

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
    """Chebyshev points in the gap."""

    reference_m: float
    """h [m]."""
    points: int
    """Number of points."""
    span_m: tuple[float, float] | None = None
    """Thinnest insulator and widest gap [m] between which the points are even in ``ln(u +
    thinnest)``; without it they are even in s."""

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
        """Choose h and the fewest points that give the attraction on every gap within 1e-4.

        Raises `InputError` if the insulators differ too much between the bands.

        Parameters
        ----------
        thickness_m : ndarray of complex, shape (bands,)
            h0 [m] of each band of frequencies.
        attraction : ndarray, shape (bands,)
            Attraction of each band in a contact spot, in any unit.
        widest_gap_m : float
            Widest gap [m].
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
            f"{thinnest:.3g} and {size.max():.3g} m; remove the drive's content near 0 Hz"
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
        power = attraction[:, None] * np.abs(h0 / (gap + h0)) ** 2
        # A weak frequency attracts by its product with a strong one: its amplitude counts.
        return float((np.sqrt(power / power.sum(axis=0)) * lack).max())


def _by_band(frequency: Array, attraction: Array) -> tuple[npt.NDArray[np.int64], Array]:
    """Return index of the strongest frequency and sum of the attraction of each non-empty band."""
    octave = np.log2(np.maximum(frequency, frequency[1] / 2) / frequency[1])
    band = np.floor(octave * _BANDS_PER_OCTAVE).astype(int)
    first = np.flatnonzero(np.diff(band, prepend=band[0] - 1))
    total = np.add.reduceat(attraction, first)
    parts = np.split(attraction, first[1:])
    strongest = first + np.array([part.argmax() for part in parts])
    used = total > _EMPTY * total.max()
    return strongest[used], total[used]


FLAT_SHARE, CLOSED_SHARE = 0.2, 0.5
"""The squared field passes whole up to the first share of the output rate, and not at all from the
second: at 10 kHz the ripple of a direct drive of up to 1 kHz stays, that of a carrier of 2.5 kHz
and more goes."""

MEMORY_S = 0.5
"""The drive this long before and after an instant counts, since insulators relax: skin in 10 ms,
gaps that leak in ``eps0 rho_g (u + h0)/h0``."""

_FINEST_HZ = 96e3  # from this rate on straight lines between samples will do: 0.2 % off at 2 kHz


@dataclass(frozen=True)
class Samples:
    """A drive signal, with 0 V before and after, band-limited between its samples."""

    volts: Array
    """The samples [V]; shape (samples,)."""
    sample_rate_hz: float
    start_s: float
    """Their rate [Hz], and the time of the first [s]."""
    thickness_m: Thickness
    """h0 [m] at frequencies [Hz]."""

    def field(self, widest_gap_m: float) -> GapField:
        """Return the points that hold this drive in gaps of up to `widest_gap_m`."""
        return GapField.for_drive(self.volts, self.sample_rate_hz, self.thickness_m, widest_gap_m)

    def excerpt(self, from_s: float, to_s: float) -> Spectrum:
        """Return the part of the drive on which the field between two times [s] depends."""
        rate = self.sample_rate_hz
        first = int(np.floor((from_s - MEMORY_S - self.start_s) * rate))
        last = int(np.ceil((to_s + MEMORY_S - self.start_s) * rate)) + 1
        count = next_fast_len(last - first, real=True)
        volts = np.zeros(count)
        low, high = max(first, 0), min(first + count, len(self.volts))
        if low < high:
            volts[low - first : high - first] = self.volts[low:high]
        # Faded in and out over half of the memory: a cut would ring over all of it.
        fade = np.hanning(2 * round(MEMORY_S / 2 * rate) + 1)
        half = len(fade) // 2
        volts[:half] *= fade[:half]
        volts[count - half :] *= fade[half + 1 :]
        finer = max(2, ceil(_FINEST_HZ / rate))  # squaring doubles the band
        spectrum = rfft(volts) * finer
        if count % 2 == 0:
            spectrum[-1] /= 2  # at a higher rate the highest frequency stands on both sides
        return Spectrum(
            start_s=self.start_s + first / rate,
            rate_hz=rate * finer,
            samples=count * finer,
            spectrum=spectrum,
            thickness_m=self.thickness_m(rfftfreq(count, 1 / rate)),
        )


@dataclass(frozen=True)
class Spectrum:
    """Part of a drive as a spectrum, read at a rate that its square needs."""

    start_s: float
    rate_hz: float
    samples: int
    """Time of the first sample [s], rate [Hz] and number of the samples read."""
    spectrum: ComplexArray
    thickness_m: ComplexArray
    """Spectrum of the voltage, up to half of the rate that it was played at; and h0 [m] there;
    shape (frequencies,)."""

    def squares(self, field: GapField, t_s: Array, output_rate_hz: float) -> Array:
        """``(E (u + h))^2`` [V^2] at the points of `field` and at times [s], (points, times).

        Band-limited for `output_rate_hz`, see `FLAT_SHARE`.
        """
        squares = np.zeros((field.points, len(t_s)))
        if not self.spectrum.any():
            return squares
        turn = rfftfreq(self.samples, 1 / self.rate_hz) / output_rate_hz - FLAT_SHARE
        turn = np.clip(turn / (CLOSED_SHARE - FLAT_SHARE), 0.0, 1.0)
        window = (1 + np.cos(np.pi * turn)) / 2
        excess = self.thickness_m / field.reference_m - 1
        t = self.start_s + np.arange(self.samples) / self.rate_hz
        for row, share in zip(squares, field.share, strict=True):
            square = irfft(rfft(self._read(1 + excess * share) ** 2) * window, self.samples)
            # The edge of a band swings a little below zero, a square cannot.
            row[:] = np.maximum(np.interp(t_s, t, square), 0.0)
        return squares

    def highest_field(self, gap_m: float, t_s: Array) -> Array:
        """Largest magnitude of the field [V/m] in a gap, between each two times [s]."""
        size = np.abs(self._read(gap_m + self.thickness_m))
        at = np.rint((t_s - self.start_s) * self.rate_hz).astype(int).clip(0, self.samples - 1)
        # reduceat's last part runs on to the end, beyond the last time.
        return np.asarray(np.maximum.reduceat(size, at)[:-1])

    def _read(self, divisor: ComplexArray) -> Array:
        """Voltage over a complex divisor, in time.

        The divisor's imaginary part is that of exp(-i w t), numpy's transform that of exp(i w t).
        """
        return np.asarray(irfft(self.spectrum / divisor.conj(), self.samples))


@dataclass(frozen=True)
class Amplitude:
    """An ideal carrier of which only the amplitude is known: its attraction has no ripple."""

    volts: Array
    """Amplitude V0 [V], linear between samples; 0 V before and after; shape (samples,)."""
    sample_rate_hz: float
    start_s: float
    """Rate of the samples [Hz], and the time of the first [s]."""
    thickness_m: complex
    """h0 [m] at the carrier's frequency."""

    def field(self, widest_gap_m: float) -> GapField:
        """Return the points that hold this drive in gaps of up to `widest_gap_m`."""
        return GapField.for_bands(np.array([self.thickness_m]), np.ones(1), widest_gap_m)

    def excerpt(self, from_s: float, to_s: float) -> Amplitude:
        """Return the whole drive, since its attraction has no memory."""
        return self

    def squares(self, field: GapField, t_s: Array, output_rate_hz: float) -> Array:
        """As in `Spectrum.squares`; an amplitude is taken to be slower than the output."""
        divisor = np.abs(1 + (self.thickness_m / field.reference_m - 1) * field.share) ** 2
        return np.asarray(self._at(t_s) ** 2 / (2 * divisor[:, None]))

    def highest_field(self, gap_m: float, t_s: Array) -> Array:
        """As in `Spectrum.highest_field`."""
        ends = self._at(t_s)
        return np.asarray(np.maximum(ends[:-1], ends[1:]) / abs(gap_m + self.thickness_m))

    def _at(self, t_s: Array) -> Array:
        place = (t_s - self.start_s) * self.sample_rate_hz
        at = np.interp(place, np.arange(len(self.volts)), self.volts, left=0.0, right=0.0)
        return np.asarray(at)


Drive = Samples | Amplitude
"""A played drive: its samples, or the amplitude of an ideal carrier."""

Excerpt = Spectrum | Amplitude
"""The part of a drive that determines the field over some time."""
