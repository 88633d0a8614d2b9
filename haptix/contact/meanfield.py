"""Persson's mean-field theory of one rough contact: area, mean gap, gap distribution.

Everything is a function of the nominal pressure p alone and is solved for a batch of pressures at
once. The magnification zeta is represented by the stress variance T(q) = tau^2(1, zeta) that the
waves up to q = zeta q0 add, on a grid uniform in ``ln(T / (T1 - T))``: it resolves both the first
waves, where a light contact breaks up within 1e-4 of q0, and the last ones, where the gaps close.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import asinh, log, pi, sqrt
from typing import Any, Literal, get_args

import numpy as np
import torch
from torch import Tensor

from haptix.contact.elasticity import ElasticSolid
from haptix.contact.gaps import GapHistogram
from haptix.contact.roughness import RoughnessSpectrum
from haptix.contact.separation import Y_MAX, SeparationIntegral
from haptix.errors import InputError
from haptix.interpolation import PiecewiseLinear

GapDistribution = Literal["plain", "combined"]
ContactSpots = Literal["excluded", "included"]

_WAVE_NODES = 4096  # nodes of T(q); T is integrated to 1e-12, q(T) interpolated to 1e-6
_STRIPS = 384  # strips in magnification: I within 5e-4 of twice this number
_DENSE_AT, _DENSE_WIDTH, _DENSE_END = 1.5, 2.0, 4.0  # in ln(T / (T1 - T)); end in widths
_SEPARATION_POINTS = 40  # Gauss points in ln(tau) of one mean separation
_Y_FLAT = 5.9  # erfc(5.9) = 7e-17: contact at this y is complete to double precision
_GAP_BINS = 400
_GAP_RANGE = (1e-9, 1e2)  # bins from and to, in units of h_rms


@dataclass(frozen=True)
class Strips:
    """The contact taken apart by magnification: each strip of area opens at one zeta.

    All tensors have the shape of the pressures plus one axis of strips; lengths in m.
    """

    share: Tensor
    """Share of the nominal area that opens in the strip."""
    separation_m: Tensor
    """u1, its mean gap; zero where it is closed to double precision."""
    variance_m2: Tensor
    """s^2, the variance of the gap about u1."""


class MeanField:
    """Contact of a rough elastic solid with a rigid plane, without adhesion.

    Sources: Persson, J. Chem. Phys. 115, 3840 (2001) for the area; Yang & Persson, J. Phys.:
    Condens. Matter 20, 215214 (2008) for the separation; Almqvist et al., JMPS 59, 2355 (2011) for
    the gap distribution. Physics page, section 2.

    Parameters
    ----------
    spectrum : RoughnessSpectrum
        The combined roughness.
    modulus : HalfSpace or Layered
        The elastic solid, anything with ``effective_modulus(q)``.
    gamma : float
        Factor of the elastic energy, in (0, 1].
    gap_distribution : {"plain", "combined"}
        Variance of a strip's gap: that of the shorter waves, or combined with u1 (later papers).
    device : str
        Where the tensors live. The arithmetic is float64 throughout.
    """

    def __init__(
        self,
        spectrum: RoughnessSpectrum,
        modulus: ElasticSolid,
        gamma: float = 0.45,
        gap_distribution: GapDistribution = "plain",
        device: torch.device | str = "cpu",
    ) -> None:
        if gap_distribution not in get_args(GapDistribution):
            raise InputError(
                f'gap_distribution: expected "plain" or "combined", got {gap_distribution!r}'
            )
        self.spectrum = RoughnessSpectrum(
            spectrum.wavenumber.to(device), spectrum.density.to(device)
        )
        self.modulus = modulus
        self.gap_distribution = gap_distribution
        self.device = torch.device(device)
        self._separation_integral = SeparationIntegral(gamma, device)
        self._points, self._weights = (
            torch.from_numpy(a).to(device)
            for a in np.polynomial.legendre.leggauss(_SEPARATION_POINTS)
        )
        self._tabulate_waves()
        h_rms = float(self.spectrum.h_rms_m)
        decades = np.geomspace(_GAP_RANGE[0] * h_rms, _GAP_RANGE[1] * h_rms, _GAP_BINS)
        self.gap_edges_m = torch.tensor([0.0, *decades], dtype=torch.float64, device=device)

    def _tabulate_waves(self) -> None:
        """T(q) and the compliance 1/(q E*) on wavenumbers graded towards q0."""
        q0, q1 = self.spectrum.q0, self.spectrum.q1
        excess = torch.linspace(
            log(1e-16), log(q1 / q0 - 1), _WAVE_NODES, dtype=torch.float64, device=self.device
        )
        kinks = torch.log(self.spectrum.wavenumber[1:-1] / q0 - 1)
        excess = torch.cat([excess, kinks]).unique()
        points, weights = (
            torch.from_numpy(a).to(self.device) for a in np.polynomial.legendre.leggauss(6)
        )
        half = excess.diff()[:, None] / 2
        ratio = torch.exp(excess[:-1, None] + half * (points + 1))
        variance_per_wave = self._variance_per_wave(q0 * (1 + ratio)) * q0 * ratio
        cells = (variance_per_wave * half * weights).sum(-1)
        first = torch.exp(excess[:1]) * q0 * self._variance_per_wave(excess.new_tensor([q0]))
        variance = torch.cat([first, cells]).cumsum(0)
        q = q0 * (1 + torch.exp(excess))
        log_compliance = -torch.log(q * self.modulus.effective_modulus(q))
        self._log_excess = PiecewiseLinear.through(torch.log(variance), excess)
        self._log_compliance = PiecewiseLinear.through(torch.log(variance), log_compliance)
        self.stress_variance = variance[-1]

    def _variance_per_wave(self, q: Tensor) -> Tensor:
        return pi * q**3 * self.spectrum(q) * self.modulus.effective_modulus(q) ** 2

    @property
    def stress_rms_pa(self) -> Tensor:
        """``tau(1, zeta1)`` [Pa], ``E* slope / sqrt(2)`` for a half-space: the scale of p."""
        return self.stress_variance.sqrt()

    def area_fraction(self, pressure_pa: Any) -> Tensor:
        """A/A0 = erf(p / tau) at full magnification, for pressures [Pa] of any shape."""
        return torch.erf(self._pressures(pressure_pa) / self.stress_rms_pa)

    def mean_gap(self, pressure_pa: Any) -> Tensor:
        """Mean separation [m] of the two surfaces, for pressures [Pa] of any shape."""
        pressure = self._pressures(pressure_pa)
        return self._separation(pressure, torch.zeros_like(pressure))

    def inverse_square_gap(
        self, pressure_pa: Any, h0_m: Any, contact_spots: ContactSpots = "included"
    ) -> Tensor:
        """``I(p, h0) = <1/|u + h0|^2>`` [1/m^2] over the nominal area (paper, Eq. 1 and 3).

        Parameters
        ----------
        pressure_pa, h0_m : float, complex or Tensor
            Pressure [Pa] and effective insulator thickness [m], real or complex; they broadcast.
        contact_spots : {"included", "excluded"}
            Count the area in contact as gaps of zero, as Eq. 3 reads, or open gaps only.
        """
        check_contact_spots(contact_spots)
        pressure = self._pressures(pressure_pa)
        h0 = torch.as_tensor(h0_m, device=self.device)
        h0 = h0.to(torch.complex128 if h0.is_complex() else torch.float64)
        thickness = h0.real if h0.is_complex() else h0
        if not bool((h0.abs().isfinite() & (thickness >= 0) & (h0.abs() > 0)).all()):
            raise InputError("h0_m: expected finite values [m] with a real part of 0 or more")
        inverse_square = self.gap_histogram(pressure).inverse_square(h0)
        if contact_spots == "included":
            inverse_square = inverse_square + self.area_fraction(pressure) / h0.abs() ** 2
        return inverse_square

    def gap_density(self, pressure_pa: Any, gap_m: Any) -> Tensor:
        """P(u) [1/m] of the open gaps; pressures [Pa] and gaps [m] broadcast.

        The contact spots' delta function at u = 0 is left out: the integral is ``1 - A/A0``.
        """
        pressure = self._pressures(pressure_pa)
        gap = torch.as_tensor(gap_m, dtype=torch.float64, device=self.device)[..., None]
        strips = self.strips(pressure)
        open_ = strips.variance_m2 > 0
        variance = torch.where(open_, strips.variance_m2, torch.ones_like(strips.variance_m2))
        weight = torch.where(open_, strips.share, torch.zeros_like(strips.share))
        peaks = sum(
            torch.exp(-((gap - side * strips.separation_m) ** 2) / (2 * variance))
            for side in (1, -1)
        )
        return (weight * peaks / torch.sqrt(2 * pi * variance)).sum(-1)

    def gap_histogram(self, pressure_pa: Any) -> GapHistogram:
        """Gap distribution binned over `gap_edges_m`, for pressures [Pa] of any shape."""
        pressure = self._pressures(pressure_pa)
        strips = self.strips(pressure)
        open_ = strips.variance_m2 > 0
        width = torch.where(open_, 2 * strips.variance_m2, torch.ones_like(strips.variance_m2))
        scale = width.rsqrt()
        weight = torch.where(open_, strips.share, torch.zeros_like(strips.share)) / 2
        centre = strips.separation_m * scale
        # The Gaussians about +u1 and -u1 on u > 0 are one Gaussian folded at zero.
        below = [torch.zeros_like(pressure)]
        for edge in self.gap_edges_m[1:-1]:
            at = edge * scale
            below.append((weight * (torch.erf(at - centre) + torch.erf(at + centre))).sum(-1))
        below.append(2 * weight.sum(-1))
        return GapHistogram(self.gap_edges_m, torch.stack(below, -1).diff(dim=-1))

    def strips(self, pressure_pa: Tensor) -> Strips:
        """Take the contact apart by magnification, for pressures [Pa] of any shape."""
        pressure = pressure_pa[..., None]
        total = self.stress_variance
        # From the magnification where contact is still complete to the last wave.
        start = ((pressure / _Y_FLAT) ** 2 / total).clamp(max=1 - 1e-6)
        low = torch.log(start) - torch.log1p(-start)
        # Densest where the gaps close (T near T1), sparser towards both ends.
        low, high = torch.asinh((low - _DENSE_AT) / _DENSE_WIDTH), asinh(_DENSE_END)
        grid = torch.linspace(0, 1, _STRIPS, dtype=torch.float64, device=self.device)
        logit = _DENSE_AT + _DENSE_WIDTH * torch.sinh(low + (high - low) * grid)
        variance = torch.cat([total * torch.sigmoid(logit), total.expand_as(low)], -1)
        rest = torch.cat([total * torch.sigmoid(-logit), torch.zeros_like(low)], -1)
        y = pressure / variance.sqrt()
        area, open_area = torch.erf(y), torch.erfc(y)
        share = torch.where(y[..., 1:] > 0.5, open_area.diff(dim=-1), -area.diff(dim=-1))
        separation = self._separation(pressure / area, variance, rest)
        # u1 = ubar + A dubar/dA = d(A ubar)/dA: as a difference over the strip it keeps the mean.
        lost = -(area * separation).diff(dim=-1)
        empty = share <= 0
        u1 = torch.where(empty, torch.zeros_like(lost), lost / share.masked_fill(empty, 1.0))
        u1 = u1.clamp(min=0.0)
        rough = self.spectrum.moment(1, self._wavenumber(variance))
        rough = (rough[..., 1:] + rough[..., :-1]) / 2
        if self.gap_distribution == "combined":
            closed = u1 <= 0
            both = 1 / (1 / rough + 1 / u1.masked_fill(closed, 1.0) ** 2)
            rough = both.masked_fill(closed, 0.0)
        return Strips(share.clamp(min=0.0), u1, rough)

    def _separation(self, pressure: Tensor, variance: Tensor, rest: Tensor | None = None) -> Tensor:
        """Mean gap at a magnification: waves from T = `variance` on, local pressure given.

        ``ubar = (2/sqrt(pi)) int dtau J(p/tau) / (q E*)``, tau from 0 to ``sqrt(T1 - T)``, in
        ln(tau) from where J vanishes. `rest` is T1 - T where the caller knows it to more digits.
        """
        rest = self.stress_variance - variance if rest is None else rest
        top = rest.sqrt()
        bottom = torch.minimum(pressure / Y_MAX, top)
        open_ = top > bottom
        safe_top = torch.where(open_, top, torch.ones_like(top))
        span = torch.log(safe_top / torch.where(open_, bottom, torch.ones_like(top)))
        total = torch.zeros_like(top)
        # A loop over the Gauss points, not over the batch, keeps every array within the cache.
        for point, weight in zip(self._points, self._weights, strict=True):
            tau = safe_top * torch.exp(span * ((point - 1) / 2))
            compliance = torch.exp(self._log_compliance(torch.log(variance + tau**2)))
            total = total + weight * tau * self._separation_integral(pressure / tau) * compliance
        total = total * span / 2
        return torch.where(open_, 2 / sqrt(pi) * total, torch.zeros_like(total))

    def _wavenumber(self, variance: Tensor) -> Tensor:
        log_excess = self._log_excess(torch.log(variance))
        return (self.spectrum.q0 * (1 + torch.exp(log_excess))).clamp(max=self.spectrum.q1)

    def _pressures(self, pressure_pa: Any) -> Tensor:
        pressure = torch.as_tensor(pressure_pa, dtype=torch.float64, device=self.device)
        if not bool((pressure.isfinite() & (pressure > 0)).all()):
            raise InputError("pressure_pa: expected finite pressures above 0 Pa")
        return pressure


def check_contact_spots(contact_spots: str) -> None:
    """Raise `InputError` unless the way to count contact spots has a name that is known."""
    if contact_spots not in get_args(ContactSpots):
        raise InputError(f'contact_spots: expected "excluded" or "included", got {contact_spots!r}')
