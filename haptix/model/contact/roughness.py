"""Surface roughness: an isotropic power spectrum C(q), piecewise a power law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log10, pi
from typing import Any, Literal, get_args

import torch
from torch import Tensor

from haptix.base import checks
from haptix.base.errors import InputError
from haptix.model.contact.power_laws import PowerLaws
from haptix.model.contact.topography import (
    MeasuredSurface,
    Removed,
    of_line_spectrum,
    over_rings,
)

_SAME_H_RMS = 1.2  # a band that ends elsewhere changes it by so much; conventions by 6.3

Convention = Literal["C", "C_iso", "C_1D"]
"""Conventions of spectra: the C of Persson, the C_iso and the C_1D of Jacobs et al. (2017)."""


@dataclass(frozen=True)
class RoughnessSpectrum(PowerLaws):
    """Power spectrum of a randomly rough surface, linear in log-log between its nodes.

    The convention is ``h_rms^2 = 2 pi int q C(q) dq`` and ``slope^2 = 2 pi int q^3 C(q) dq``
    (Persson et al., J. Phys.: Condens. Matter 17, R1 (2005)). Build one with `self_affine`,
    `from_table` or `from_topography`.
    """

    notes: tuple[str, ...] = ()
    """How a measured one came about, such as the form that was removed. One that begins with
    "warning: " names a value that is likely to be wrong."""
    measured_per_m: tuple[float, float] | None = None
    """Band [1/m] that was measured, where the spectrum was extended."""

    @classmethod
    def self_affine(
        cls, h_rms_m: float | Tensor, hurst: float, q0: float, q_rolloff: float, q1: float
    ) -> RoughnessSpectrum:
        """Constant from `q0` to the roll-off, then ``q^(-2(1+H))`` up to `q1`.

        Parameters
        ----------
        h_rms_m : float or Tensor
            Root-mean-square roughness [m].
        hurst : float
            Hurst exponent H, in (0, 1].
        q0, q_rolloff, q1 : float
            Lowest wavenumber, roll-off and highest wavenumber [1/m], ``0 < q0 <= q_rolloff <= q1``.

        Raises
        ------
        InputError
            If a value is outside its range.

        Examples
        --------
        >>> spectrum = RoughnessSpectrum.self_affine(1e-6, hurst=0.8, q0=1e4, q_rolloff=1e5, q1=1e7)
        >>> print(f"{float(spectrum.h_rms_m):.3e} m")
        1.000e-06 m
        """
        for name, value in (("h_rms_m", h_rms_m), ("q0", q0), ("q1", q1), ("hurst", hurst)):
            checks.positive(name, value)
        if hurst > 1:
            raise InputError(f"hurst: expected a Hurst exponent in (0, 1], got {hurst:g}")
        if not q0 <= q_rolloff <= q1 or q0 == q1:
            raise InputError(
                "expected q0 <= q_rolloff <= q1 and q0 < q1 [1/m], "
                f"got {q0:g}, {q_rolloff:g}, {q1:g}"
            )
        nodes = sorted({float(q0), float(q_rolloff), float(q1)})
        q = torch.tensor(nodes, dtype=torch.float64)
        shape = torch.clamp(q / q_rolloff, min=1.0) ** (-2 * (1 + hurst))
        unscaled = cls(q, shape)
        h_rms = torch.as_tensor(h_rms_m, dtype=torch.float64)
        return cls(q, shape * h_rms**2 / unscaled.moment(1))

    @classmethod
    def from_table(cls, q: Any, c: Any, convention: Convention = "C") -> RoughnessSpectrum:
        """Take a measured spectrum: wavenumbers [1/m] and densities, array-likes of one length.

        Parameters
        ----------
        q : array-like, shape (n,)
            Wavenumbers [1/m], 2 pi over the wavelength, increasing.
        c : array-like, shape (n,)
            Spectrum at them, in the units of its convention.
        convention : {"C", "C_iso", "C_1D"}
            "C" [m^4] of Persson, with ``h_rms^2 = 2 pi int q C dq``. "C_iso" [m^4] of Jacobs,
            Junge, Pastewka (Surf. Topogr. Metrol. Prop. 5, 013001, 2017), which SurfaceTopography
            writes, is 4 pi^2 times as large: ``h_rms^2 = int q C_iso dq / (2 pi)``. "C_1D" [m^3],
            that of line scans, has ``h_rms^2 = int C_1D dq / pi``.

        Raises
        ------
        InputError
            If the table is not one-dimensional, finite, positive and increasing in q.

        Examples
        --------
        >>> measured = RoughnessSpectrum.from_table([1e3, 1e4, 1e5], [1e-19, 1e-20, 1e-23])
        >>> bool(measured.h_rms_m > 0)
        True
        """
        if convention not in get_args(Convention):
            names = ", ".join(f'"{name}"' for name in get_args(Convention))
            raise InputError(f"convention: expected one of {names}, got {convention!r:.40}")
        try:
            wavenumber = torch.as_tensor(q, dtype=torch.float64)
            density = torch.as_tensor(c, dtype=torch.float64)
        except (TypeError, ValueError, RuntimeError):
            raise InputError("q and c: expected two tables of numbers") from None
        if wavenumber.ndim != 1 or wavenumber.shape != density.shape or len(wavenumber) < 2:
            raise InputError(
                "expected q and c as two one-dimensional tables of one length (2 or more), "
                f"got shapes {tuple(wavenumber.shape)} and {tuple(density.shape)}"
            )
        rising = (wavenumber > 0).all() & (wavenumber.diff() > 0).all()
        if not bool(rising & wavenumber.isfinite().all()):
            raise InputError("q: expected positive wavenumbers [1/m] in increasing order")
        if not bool((density > 0).all() and density.isfinite().all()):
            raise InputError("c: expected positive finite C(q) [m^4]; drop empty bins first")
        if convention == "C_1D":
            rings = of_line_spectrum(PowerLaws(wavenumber, density))
            return cls(rings.wavenumber, rings.density)
        return cls(wavenumber, density / (4 * pi**2 if convention == "C_iso" else 1.0))

    @classmethod
    def from_topography(
        cls,
        height_m: Any,
        pixel_m: float | Sequence[float] | None = None,
        is_periodic: bool | None = None,
        remove: Removed | None = None,
    ) -> RoughnessSpectrum:
        """Radially averaged spectrum of a height map, or that of line scans of one surface.

        The mean squares of the heights, and of a map's slope, are those of its pixels. A Hann
        window suppresses the jump at the borders, except where the map is periodic. The spectrum
        has no waves outside ``2 pi / side`` to ``pi / pixel_m``; `extended` adds them by a law.
        Its `notes` list each step, and warn of a form that was left in.

        Parameters
        ----------
        height_m : array_like, SurfaceTopography.Topography, or a list of line scans
            Heights [m]; a list of arrays of one dimension are line scans, each at a place of its
            own, and a map is one array or a list of lists. A topography brings its own unit, pixels
            and period. Masked points, and those that are not finite, are missing: up to 5 % of them
            are filled.
        pixel_m : float or (float, float)
            Distance between pixels [m], or between rows and between columns; left out for a
            topography.
        is_periodic : bool, optional
            Whether the map goes on at its borders as it began.
        remove : {"mean", "plane", "radius", "form"}, optional
            Polynomial that is removed: of degree 0, 1, 2 (a fingertip's radius of curvature) or 4
            (the form of a whole fingertip). By default a plane, or the mean of a periodic map.

        Raises
        ------
        InputError
            If the map is too small or flat, too much of it is missing, or its unit or pixels are
            not known.

        Examples
        --------
        >>> height_m = torch.randn(64, 64, dtype=torch.float64) * 1e-6
        >>> spectrum = RoughnessSpectrum.from_topography(height_m, pixel_m=1e-5, is_periodic=True)
        >>> print(f"{float(spectrum.h_rms_m / height_m.std(correction=0)):.6f}")
        1.000000
        """
        return cls.of_surface(MeasuredSurface.of(height_m, pixel_m, is_periodic), remove)

    @classmethod
    def of_surface(
        cls, surface: MeasuredSurface, remove: Removed | None = None
    ) -> RoughnessSpectrum:
        """Return the spectrum of a surface that was read; otherwise as `from_topography`.

        Parameters
        ----------
        surface : MeasuredSurface
            A height map, or line scans.
        remove
            As for `from_topography`.
        """
        rings, notes = surface.spectrum(remove)
        return cls(rings.wavenumber, rings.density, notes)

    def of_few_nodes(self) -> RoughnessSpectrum:
        """Return a spectrum of some ten nodes a decade that has the power of one of many."""
        rings = over_rings(self)
        return RoughnessSpectrum(rings.wavenumber, rings.density, self.notes, self.measured_per_m)

    def extended(self, hurst: float, q1: float = 1e9, q0: float | None = None) -> RoughnessSpectrum:
        """Return a copy with the waves that an instrument did not see, by a law that is stated.

        Parameters
        ----------
        hurst : float
            Hurst exponent H of the shorter waves, in (0, 1]: ``C ~ q^(-2(1+H))``.
        q1 : float
            Wavenumber [1/m] up to which it goes on, if that is further; molecules end it at 1e9 /m.
        q0 : float, optional
            Wavenumber [1/m] down to which C stays as it is at the lowest measured one.

        Raises
        ------
        InputError
            If a value is outside its range.

        Examples
        --------
        >>> seen = RoughnessSpectrum.from_table([1e3, 1e4, 1e5], [1e-19, 1e-20, 1e-23])
        >>> whole = seen.extended(hurst=0.86)
        >>> whole.q1, bool(whole.slope_rms > seen.slope_rms)
        (1000000000.0, True)
        """
        checks.positive("hurst", hurst)
        if hurst > 1:
            raise InputError(f"hurst: expected a Hurst exponent in (0, 1], got {hurst:g}")
        q, c, notes = self.wavenumber, self.density, list(self.notes)
        if q0 is not None and q0 < self.q0:
            checks.positive("q0", q0)
            q, c = torch.cat([q.new_tensor([q0]), q]), torch.cat([c[:1], c])
            notes.append(f"from {q0:.3g} to {self.q0:.3g} /m extended as constant")
        if q1 > self.q1:
            last = c[-1:] * (q1 / self.q1) ** (-2 * (1 + hurst))
            q, c = torch.cat([q, q.new_tensor([q1])]), torch.cat([c, last])
            notes.append(f"from {self.q1:.3g} to {q1:.3g} /m extended with H = {hurst:g}")
        if len(notes) == len(self.notes):
            return self
        band = self.measured_per_m or (self.q0, self.q1)
        return RoughnessSpectrum(q, c, tuple(notes), band)

    def of_measured_band(self) -> RoughnessSpectrum:
        """Return a copy without the waves that were added by a law."""
        low, high = self.measured_per_m or (self.q0, self.q1)
        seen = (self.wavenumber >= low * (1 - 1e-9)) & (self.wavenumber <= high * (1 + 1e-9))
        return RoughnessSpectrum(self.wavenumber[seen], self.density[seen], self.notes)

    def check_h_rms(self, h_rms_m: Any) -> None:
        """Refuse another root-mean-square roughness [m] than its own, as a wrong convention gives.

        Raises
        ------
        InputError
            If they differ by more than 20 %; the message names the convention that would fit.

        Examples
        --------
        >>> RoughnessSpectrum.self_affine(23e-6, 0.8, 1e3, 1e4, 1e6).check_h_rms(22e-6)
        """
        stated = checks.plain(h_rms_m)
        if stated is None:
            raise InputError(f"h_rms_m: expected a number [m], got {h_rms_m!r:.40}")
        checks.positive("h_rms_m", stated)
        ratio = float(self.h_rms_m.detach()) / stated
        if abs(log10(ratio)) > log10(_SAME_H_RMS):
            known = {2 * pi: "C_iso", 1 / (2 * pi): "C"}
            fits = [name for factor, name in known.items() if 1 / 1.2 < ratio / factor < 1.2]
            meant = f'; with convention = "{fits[0]}" it would be the same' if fits else ""
            raise InputError(
                f"h_rms_m: expected {stated:.3g} m as stated, but the spectrum has "
                f"{stated * ratio:.3g} m: another convention, unit or band{meant}"
            )

    @property
    def q_rolloff(self) -> float:
        """Wavenumber [1/m] that contributes most to the mean square: where ``q^2 C`` is highest."""
        q, c = self.wavenumber.detach(), self.density.detach()
        return float(q[(q**2 * c).argmax()])

    @property
    def h_rms_m(self) -> Tensor:
        """Root-mean-square roughness [m].

        Examples
        --------
        >>> rough = RoughnessSpectrum.self_affine(1e-6, 0.8, 1e3, 1e4, 1e6)
        >>> round(float(rough.h_rms_m) * 1e6, 6)
        1.0
        """
        return self.moment(1).sqrt()

    @property
    def slope_rms(self) -> Tensor:
        """Root-mean-square slope (of the gradient's magnitude)."""
        return self.moment(3).sqrt()

    def statement(self) -> str:
        """Describe the band, height and slope in one line."""
        decades = log10(self.q1 / self.q0)
        return (
            f"waves of {self.q0:.3g} to {self.q1:.3g} /m ({decades:.1f} decades), h_rms "
            f"{float(self.h_rms_m.detach()):.3g} m, rms slope {float(self.slope_rms.detach()):.3g}"
            + "".join(f"; {note}" for note in self.notes)
        )
