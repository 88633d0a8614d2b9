"""Persson's mean-field theory of one rough contact: area, mean gap, gap distribution.

Everything is a function of the nominal pressure p alone and is solved for a batch of pressures at
once. The magnification zeta is represented by the stress variance T(q) = tau^2(1, zeta) that the
waves up to q = zeta q0 add, on a grid uniform in ``ln(T / (T1 - T))``: it resolves both the first
waves, where a light contact breaks up within 1e-4 of q0, and the last ones, where the gaps close.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import ceil, inf, log, pi, sqrt
from typing import Any, Literal, get_args

import numpy as np
import torch
from torch import Tensor

from haptix.contact.area import AreaLaw
from haptix.contact.elasticity import ElasticSolid
from haptix.contact.finite_size import (
    SizeLaw,
    Touching,
    highest_asperity,
    highest_peak,
    once_for_equals,
    peaks_per_area,
    touching_log_pressure,
)
from haptix.contact.roughness import RoughnessSpectrum
from haptix.contact.tables import Y_MAX, PiecewiseLinear, SeparationIntegral, UniformCubic
from haptix.errors import InputError
from haptix.threads import one_thread

GapDistribution = Literal["plain", "combined"]
ContactSpots = Literal["excluded", "included", "widened"]
TheoryName = Literal["local", "corrected", "open-gaps", "as-published"]

_NARROW = 0.05  # below, what five terms of the series leave out is t^10/11 < 1e-14
_WAVE_NODES = 4096  # nodes of T(q); T is integrated to 1e-12, q(T) interpolated to 1e-6
_WAVE_RANGE = log(1e16)  # they reach from q1 down to where q/q0 - 1 is this much smaller
_STRIPS = 512  # strips in magnification
_DENSE_AT, _DENSE_WIDTH = 1.5, 2.0  # in ln(T / (T1 - T))
_LAST_LOGIT = 56.0  # there T1 - T is below rounding
_PER_WAVE = 0.2  # strips in ln(q/q0 - 1) for one in asinh(ln(T / (T1 - T)))
_TINY = 1e-300
_TOUCHING_RANGE, _TOUCHING_STEP = (-46.0, 2.0), log(10) / 12  # of ln p/tau
_LEAST_EXCESS = 1e-7  # q/q0 - 1 from which a separation with a reach is integrated
_SPOT_RANGE = -30.0, 40.0  # of ln (q_s/q_c)^2: all waves count, or none
_SPOT_NODES = 351  # of the share that counts, on steps of 0.2: the cubic is right to 1e-6
_SEPARATION_POINTS = 32  # Gauss points, at most, in each panel of one mean separation
_FIRST_SPAN, _PER_SPAN = 8.0, 2.0  # of ln(q/q0 - 1) in the first panel; points for each 1 of it
_MOST_BENDS = 20  # of a spectrum that is integrated from bend to bend
_LEAST_BAND = 3.0  # q1/q0; the theory is one of many waves, two decades of them are usual
_Y_FLAT = 5.9  # erfc(5.9) = 7e-17: contact at this y is complete to double precision
_GAP_BINS = 600  # with the strips: I within 3e-4 for any contact, 1e-4 usually
_GAP_RANGE = (1e-9, 1e2)  # bins from and to, in units of h_rms


@dataclass(frozen=True)
class Strips:
    """The contact resolved by magnification: each strip of area opens at one zeta.

    All tensors have the shape of the pressures plus one axis of strips; lengths in m.
    """

    share: Tensor
    """Share of the nominal area that opens in the strip."""
    separation_m: Tensor
    """u1, its mean gap; zero where it is closed to double precision."""
    variance_m2: Tensor
    """s^2, the variance of the gap about u1."""


@dataclass(frozen=True)
class GapHistogram:
    """Share of the nominal area whose gap lies in each bin, open gaps only."""

    edges_m: Tensor
    """Bin edges [m], shape (bins + 1,), from 0 up; the last bin also holds everything above."""
    mass: Tensor
    """Shares, shape (..., bins); they sum to ``1 - A/A0``. Under the "combined" distribution the
    strips that are closed to double precision have no width and are left out: 1.2 % of A in light
    contact, but most of what is still open near complete contact, where "plain" is better."""

    def inverse_square(self, h0_m: Tensor) -> Tensor:
        """``sum over gaps of 1/|u + h0|^2`` [1/m^2]; `h0_m` broadcasts with the batch of masses."""
        kernel = bin_inverse_square(self.edges_m, h0_m)
        return (self.mass * kernel).sum(-1)


def bin_inverse_square(edges_m: Tensor, h0_m: Tensor) -> Tensor:
    """Mean of ``1/|u + h0|^2`` over each bin, for every h0: shape ``h0.shape + (bins,)``.

    With h0 = a + i b the integral is an arctangent; written as ``atan(t)/t / D`` with
    ``D = b^2 + (u_low + a)(u_high + a)`` it covers real and complex h0 without cancellation.
    """
    h0 = h0_m[..., None]
    real = h0.real if h0.is_complex() else h0
    imaginary = h0.imag if h0.is_complex() else torch.zeros_like(real)
    low, high = edges_m[:-1] + real, edges_m[1:] + real
    # |u + h0|^2 itself at the lower edge for the open-ended last bin: what lies there is noise.
    divisor = imaginary**2 + low * high
    t = (high - low) * imaginary.abs() / divisor
    # Nearly all bins are narrow against their gaps, where a series gives atan(t)/t.
    square = t * t
    if float(square.detach().max()) < _NARROW**2:
        ratio = 1 - square * (1 / 3 - square * (1 / 5 - square * (1 / 7 - square / 9)))
    else:
        safe = torch.where(t < 1e-3, torch.ones_like(t), t)
        ratio = torch.where(t < 1e-3, 1 - square / 3, torch.atan(safe) / safe)
    return ratio / divisor


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
        Device of the tensors. The arithmetic is float64 throughout.
    area : AreaLaw, optional
        Law of the area; by default Persson's.
    power : float
        Power of the area with which the rest of the elastic energy grows, above 1.
    reach : float
        The energy of a wave follows the area in contact as waves this many times shorter leave it,
        1 or more: its own share of the stress is lost where they break the contact up.
    size : {"capped", "smooth", "mean-gap"}
        How a contact of finite size leaves that of infinite size (`haptix.contact.finite_size`).

    Examples
    --------
    >>> from haptix.contact import HalfSpace, MeanField, RoughnessSpectrum
    >>> spectrum = RoughnessSpectrum.self_affine(1.0, 0.8, 1.0, 1.0, 1e3)
    >>> contact = MeanField(spectrum, HalfSpace(0.75, 0.5))
    >>> print(f"{float(contact.area_fraction(1e-2)):.4e}")  # physics page, section 5
    2.0706e-03
    """

    def __init__(
        self,
        spectrum: RoughnessSpectrum,
        modulus: ElasticSolid,
        gamma: float = 0.45,
        gap_distribution: GapDistribution = "plain",
        device: torch.device | str = "cpu",
        area: AreaLaw | None = None,
        power: float = 3.0,
        reach: float = 1.0,
        size: SizeLaw = "capped",
    ) -> None:
        if not 1 <= reach < inf:
            raise InputError(f"reach: expected a number of 1 or more, got {reach:g}")
        if size not in get_args(SizeLaw):
            names = ", ".join(f'"{name}"' for name in get_args(SizeLaw))
            raise InputError(f"size: expected one of {names}, got {size!r}")
        if gap_distribution not in get_args(GapDistribution):
            raise InputError(
                f'gap_distribution: expected "plain" or "combined", got {gap_distribution!r}'
            )
        if spectrum.q1 < _LEAST_BAND * spectrum.q0:
            raise InputError(
                f"spectrum: expected waves from q0 to {_LEAST_BAND:g} q0 or shorter, since the "
                f"slope that decides the area comes from short waves, got {spectrum.q0:g} to "
                f"{spectrum.q1:g} /m; measure finer, or add the short waves as a self-affine tail"
            )
        self.spectrum = RoughnessSpectrum(
            spectrum.wavenumber.to(device), spectrum.density.to(device)
        )
        self.modulus = modulus
        self.gap_distribution = gap_distribution
        self.gamma = gamma
        self.device = torch.device(device)
        self.area = area or AreaLaw()
        self.reach = reach
        self.size: SizeLaw = size
        self._separation_integral = SeparationIntegral(gamma, device, self.area, power)
        self._tabulate_waves()
        self._h_rms_m = self.spectrum.h_rms_m
        self._peaks_per_m2 = peaks_per_area(self.spectrum) if size != "capped" else None
        h_rms = float(self._h_rms_m.detach())
        decades = np.geomspace(_GAP_RANGE[0] * h_rms, _GAP_RANGE[1] * h_rms, _GAP_BINS)
        self.gap_edges_m = torch.tensor([0.0, *decades], dtype=torch.float64, device=device)

    def _tabulate_waves(self) -> None:
        """Tabulate q and 1/(q E*) against ``ln(T / (T1 - T))``, graded to both ends."""
        q0, q1 = self.spectrum.q0, self.spectrum.q1
        top = log(q1 / q0 - 1)
        even = torch.linspace(top - _WAVE_RANGE, top, _WAVE_NODES, dtype=torch.float64)
        near_q1 = torch.log(q1 * (1 - torch.logspace(-4, -2, 16, dtype=torch.float64)) / q0 - 1)
        bent = self.spectrum.wavenumber[1:-1].detach().cpu()
        if self.reach > 1:
            bent = torch.cat([bent, bent / self.reach, bent.new_tensor([q1 / self.reach])])
        kinks = torch.log(bent[bent > q0] / q0 - 1)
        excess = torch.cat([even, near_q1[near_q1.isfinite()], kinks]).unique().to(self.device)
        points, weights = (
            torch.from_numpy(a).to(self.device) for a in np.polynomial.legendre.leggauss(6)
        )
        half = excess.diff()[:, None] / 2
        ratio = torch.exp(excess[:-1, None] + half * (points + 1))
        variance_per_wave = self._variance_per_wave(q0 * (1 + ratio)) * q0 * ratio
        cells = (variance_per_wave * half * weights).sum(-1)
        first = torch.exp(excess[:1]) * q0 * self._variance_per_wave(excess.new_tensor([q0]))
        below = torch.cat([first, cells]).cumsum(0)
        above = cells.flip(0).cumsum(0).flip(0)  # summed from q1 down: T1 - T keeps its digits
        self.stress_variance = below[-1]
        if self.area.tips:
            self._tabulate_spots(cells, q0 * (1 + torch.exp((excess[1:] + excess[:-1]) / 2)))
        logit = torch.log(below[:-1]) - torch.log(above)
        self._log_excess = PiecewiseLinear.through(logit, excess[:-1])
        self._logit_range = float(logit[0].detach()), float(logit[-1].detach())
        # Strips are densest where the gaps close (T near T1) and sparser towards both ends; where a
        # layer makes T stand still while q runs over decades, they follow q.
        place = torch.asinh((logit - _DENSE_AT) / _DENSE_WIDTH) + _PER_WAVE * excess[:-1]
        self._strip_place = PiecewiseLinear.through(logit, place)
        self._strip_logit = PiecewiseLinear.through(place, logit)
        q = q0 * (1 + torch.exp(excess))
        # dT/dw / (2 q E*) with w = ln(q/q0 - 1)
        opening = pi / 2 * q**2 * self.spectrum(q) * self.modulus.effective_modulus(q)
        log_opening = torch.log(opening * q0) + excess
        log_below = torch.log(below)
        if self.reach > 1:
            shorter = torch.log(self.reach * (1 + torch.exp(excess)) - 1).clamp(max=top)
            log_below = PiecewiseLinear.through(excess, log_below)(shorter)
        self._log_waves = PiecewiseLinear.through(excess, torch.stack([log_below, log_opening], -1))
        # Panels of the separation integral: up to where q doubles q0, then from bend to bend of the
        # spectrum, or evenly where a measured one has many.
        last = float(excess[-1])
        bends = [0.0, *(float(kink) for kink in kinks)]
        if len(bends) > _MOST_BENDS:
            bends = np.arange(0.0, last, 0.5).tolist()
        ends = [*sorted(bend for bend in bends if bend < last), last]
        counts = [_SEPARATION_POINTS // 2 if len(bends) > 4 else _SEPARATION_POINTS] * len(ends)
        if self.reach > 1 and len(bends) <= _MOST_BENDS:
            # With a reach no wave's tau vanishes, and a short panel needs few points.
            spans = [_FIRST_SPAN, *np.diff(ends)]
            counts = [min(_SEPARATION_POINTS, 6 + ceil(_PER_SPAN * span)) for span in spans]
        rules = (np.stack(np.polynomial.legendre.leggauss(count), -1) for count in counts)
        self._panels = [
            (end, torch.from_numpy(rule).to(self.device))
            for end, rule in zip(ends, rules, strict=True)
        ]

    def _tabulate_spots(self, variance: Tensor, q: Tensor) -> None:
        """Tabulate ``ln T_s / T1`` against ``ln (q_s/q_c)^2``, given the waves' variances."""
        scaled = (q / q[-1]) ** -2
        second, fourth = (variance * scaled).sum(), (variance * scaled**2).sum()
        curved = second / fourth
        self._log_tip_stress = torch.log(second * curved) / 3 + log(self.area.tips)
        start, end = _SPOT_RANGE
        nodes = torch.linspace(start, end, _SPOT_NODES, dtype=torch.float64, device=q.device)
        kept = 1 / (1 + torch.exp(nodes)[:, None] * (curved * scaled))
        share = torch.log(kept @ variance / self.stress_variance)
        step = (end - start) / (_SPOT_NODES - 1)
        self._log_spot_share = UniformCubic.through(start, step, share)

    def _variance_per_wave(self, q: Tensor) -> Tensor:
        return pi * q**3 * self.spectrum(q) * self.modulus.effective_modulus(q) ** 2

    def equals(self, other: MeanField) -> bool:
        """Whether another has the same numbers, and so the same gaps at every pressure."""
        mine, theirs = (
            (
                *(field.gamma, field.gap_distribution, field.area, field.device),
                *(field._separation_integral.power, field.reach),
            )
            for field in (self, other)
        )
        pairs = (
            (self.spectrum.wavenumber, other.spectrum.wavenumber),
            (self.spectrum.density, other.spectrum.density),
            (self._log_waves.slope, other._log_waves.slope),
        )
        return mine == theirs and all(torch.equal(one, two) for one, two in pairs)

    @property
    def stress_rms_pa(self) -> Tensor:
        """``tau(1, zeta1)`` [Pa], ``E* slope / sqrt(2)`` for a half-space: the scale of p."""
        return self.stress_variance.sqrt()

    def area_fraction(self, pressure_pa: Any) -> Tensor:
        """A/A0 at full magnification, for pressures [Pa] of any shape: erf(p / tau) by Persson."""
        return torch.erf(self.area_argument(self._pressures(pressure_pa)))

    def area_argument(self, pressure_pa: Tensor) -> Tensor:
        """Return t at pressures [Pa] of any shape, of which the area fraction is ``erf(t)``."""
        return self.area.argument(self.relative_pressure(pressure_pa))

    def relative_pressure(self, pressure_pa: Tensor) -> Tensor:
        """Return ``y = p / tau`` of the waves that count at pressures [Pa] of any shape."""
        y = pressure_pa / self.stress_rms_pa
        if self.area.tips:
            at = self._log_tip_stress - 2 / 3 * torch.log(pressure_pa)
            low, high = _SPOT_RANGE
            # Beyond the table all waves count, or T_s is proportional to q_s^-2.
            inside = self._log_spot_share(at.clamp(low, high))
            y = y * torch.exp((at.clamp(min=high) - high - inside) / 2)
        return y

    def highest_asperity(self, apparent_area_m2: Tensor) -> Tensor:
        """Height [m] that the mean gap of unloaded surfaces has, for A0 [m^2] of any shape."""
        if self._peaks_per_m2 is None:
            return highest_asperity(self._h_rms_m, self.spectrum.q_rolloff, apparent_area_m2)
        of_area = partial(highest_peak, self._h_rms_m, self._peaks_per_m2)
        return once_for_equals(of_area, apparent_area_m2)

    def touching(self, height_m: Tensor, log_mean_gap: UniformCubic | None = None) -> Touching:
        """Finite size of states whose highest asperity is given, in any shape.

        The table of `log_mean_gap` may be given as well, where it is needed often.
        """
        table = log_mean_gap or self.log_mean_gap()
        log_pressure = once_for_equals(partial(touching_log_pressure, table), torch.log(height_m))
        return Touching(log_pressure, self.size)

    @one_thread()
    def log_mean_gap(self) -> UniformCubic:
        """Tabulate ln of the mean gap [m] against ln p [Pa], down to the lightest contacts."""
        low, high = _TOUCHING_RANGE
        nodes = torch.arange(low, high, _TOUCHING_STEP, dtype=torch.float64, device=self.device)
        at = torch.log(self.stress_rms_pa) + nodes
        gap = torch.log(self.mean_gap(torch.exp(at)).clamp(min=_TINY))
        return UniformCubic.through(at[0], _TOUCHING_STEP, gap)

    @one_thread()
    def mean_gap(self, pressure_pa: Any) -> Tensor:
        """Mean separation [m] of the two surfaces, for pressures [Pa] of any shape."""
        pressure = self._pressures(pressure_pa)
        return self._separation(pressure, torch.zeros_like(pressure), self.stress_variance)

    def inverse_square_gap(
        self, pressure_pa: Any, h0_m: Any, contact_spots: ContactSpots = "included"
    ) -> Tensor:
        """``I(p, h0) = <1/|u + h0|^2>`` [1/m^2] over the nominal area (paper, Eq. 1 and 3).

        Parameters
        ----------
        pressure_pa, h0_m : float, complex or Tensor
            Pressure [Pa] and effective insulator thickness [m], real or complex; they broadcast.
        contact_spots : {"included", "excluded"}
            Count the area in contact as gaps of zero, as Eq. 3 reads, or open gaps only. This
            is the paper's mean; what loads the contact is the choice of `ContactModel`.
        """
        check_contact_spots(contact_spots)
        pressure = self._pressures(pressure_pa)
        h0 = self._numbers("h0_m", h0_m)
        thickness = h0.real if h0.is_complex() else h0
        if not bool((h0.abs().isfinite() & (thickness >= 0) & (h0.abs() > 0)).all()):
            raise InputError("h0_m: expected finite values [m] with a real part of 0 or more")
        inverse_square = self.gap_histogram(pressure).inverse_square(h0)
        if contact_spots == "included":
            inverse_square = inverse_square + self.area_fraction(pressure) / h0.abs() ** 2
        return inverse_square

    @one_thread()
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

    @one_thread()
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
        """Resolve the contact by magnification, for pressures [Pa] of any shape."""
        pressure = pressure_pa[..., None]
        total = self.stress_variance
        # From the magnification where contact is still complete to the last wave.
        start = ((pressure / _Y_FLAT) ** 2 / total).clamp(max=1 - 1e-6)
        low = torch.log(start) - torch.log1p(-start)
        low = self._strip_place(low)
        high = self._strip_place(low.new_tensor(self._logit_range[1]).clamp(max=_LAST_LOGIT))
        grid = torch.linspace(0, 1, _STRIPS, dtype=torch.float64, device=self.device)
        logit = self._strip_logit(low + (high - low) * grid)
        variance = torch.cat([total * torch.sigmoid(logit), total.expand_as(low)], -1)
        rest = torch.cat([total * torch.sigmoid(-logit), torch.zeros_like(low)], -1)
        y = self.area.argument(pressure / variance.sqrt())
        area, open_area = torch.erf(y), torch.erfc(y)
        share = torch.where(y[..., 1:] > 0.5, open_area.diff(dim=-1), -area.diff(dim=-1))
        separation = self._separation(pressure / area, variance, rest)
        # u1 = ubar + A dubar/dA = d(A ubar)/dA: as a difference over the strip it keeps the mean.
        lost = -(area * separation).diff(dim=-1)
        empty = share <= 0
        u1 = torch.where(empty, torch.zeros_like(lost), lost / share.masked_fill(empty, 1.0))
        u1 = u1.clamp(min=0.0)
        rough = self.spectrum.moment(1, self._wavenumber(torch.cat([logit, logit[..., -1:]], -1)))
        rough = (rough[..., 1:] + rough[..., :-1]) / 2
        if self.gap_distribution == "combined":
            closed = u1 <= 0
            both = 1 / (1 / rough + 1 / u1.masked_fill(closed, 1.0) ** 2)
            rough = both.masked_fill(closed, 0.0)
        return Strips(share.clamp(min=0.0), u1, rough)

    def _separation(self, pressure: Tensor, variance: Tensor, rest: Tensor) -> Tensor:
        """Mean gap at a magnification: waves from T = `variance` on, local pressure given.

        ``ubar = (2/sqrt(pi)) int dtau J(p/tau) / (q E*)``, tau from 0 to ``sqrt(T1 - T)`` (given as
        `rest`). Where J does not vanish, tau is no less than a sixth of sqrt(T): the integral is
        smooth in ``w = ln(q/q0 - 1)``, whatever the solid's layers make of tau(q).
        """
        rest = rest.expand_as(pressure)
        start = (pressure / Y_MAX) ** 2
        open_ = rest > start
        above = torch.where(open_, rest - start, torch.ones_like(rest))
        low = self._log_excess_at(variance + start, above)
        if self.reach > 1:  # from where the shorter waves reach that stress, or from this wave on
            low = torch.log(((1 + torch.exp(low)) / self.reach - 1).clamp(min=_LEAST_EXCESS))
            whole = torch.where(open_, rest, torch.ones_like(rest))
            low = torch.maximum(low, self._log_excess_at(variance.clamp(min=_TINY), whole))
        total = self._separation_integral.over_waves(
            pressure, variance, low, self._log_waves, self._panels
        )
        return torch.where(open_, total / sqrt(pi), torch.zeros_like(total))

    def _log_excess_at(self, variance: Tensor, rest: Tensor) -> Tensor:
        """Return ``ln(q/q0 - 1)`` at T and T1 - T."""
        logit = torch.log(variance) - torch.log(rest)
        return self._log_excess(logit.clamp(max=self._logit_range[1]))

    def _wavenumber(self, logit: Tensor) -> Tensor:
        log_excess = self._log_excess(logit.clamp(max=self._logit_range[1]))
        return (self.spectrum.q0 * (1 + torch.exp(log_excess))).clamp(max=self.spectrum.q1)

    def _pressures(self, pressure_pa: Any) -> Tensor:
        pressure = self._numbers("pressure_pa", pressure_pa)
        if pressure.is_complex() or not bool((pressure.isfinite() & (pressure > 0)).all()):
            raise InputError("pressure_pa: expected finite pressures above 0 Pa")
        return pressure

    def _numbers(self, name: str, value: Any) -> Tensor:
        """Return a float64 or complex128 tensor; other values are read by numpy."""
        try:
            tensor = value if isinstance(value, Tensor) else torch.as_tensor(np.asarray(value))
            wide = torch.complex128 if tensor.is_complex() else torch.float64
            return tensor.to(self.device, wide)
        except (TypeError, ValueError, RuntimeError):
            raise InputError(f"{name}: expected numbers, got {value!r}") from None


def check_contact_spots(contact_spots: str) -> None:
    """Raise `InputError` unless `contact_spots` is "excluded" or "included"."""
    if contact_spots not in get_args(ContactSpots):
        raise InputError(
            f'contact_spots: expected "excluded", "included" or "widened", got {contact_spots!r}'
        )


@dataclass(frozen=True)
class Theory:
    """One form of the mean field: choices that belong together, under one name."""

    area: AreaLaw
    """Law of the real contact area."""
    gamma: float
    """Factor of the elastic energy in the separation."""
    gap_distribution: GapDistribution
    """Variance of the gaps."""
    contact_spots: ContactSpots
    """Whether the attraction inside the contact spots presses on the contact."""
    source: str
    """Where the choices come from."""
    power: float = 3.0
    """Power of the area in the rest of the elastic energy."""
    reach: float = 1.0
    """How many times shorter the waves are that a wave's own energy follows."""
    size: SizeLaw = "capped"
    """How a contact of finite size leaves that of infinite size."""
    usual_terms: frozenset[str] = frozenset()
    """Terms on request that this form has on by default."""

    def mean_field(
        self,
        spectrum: RoughnessSpectrum,
        modulus: ElasticSolid,
        gamma: float | None = None,
        gap_distribution: GapDistribution | None = None,
        device: torch.device | str = "cpu",
    ) -> MeanField:
        """Contact of a rough solid in this form, unless gamma or the gaps are given."""
        return MeanField(
            spectrum,
            modulus,
            gamma=self.gamma if gamma is None else gamma,
            gap_distribution=gap_distribution or self.gap_distribution,
            device=device,
            area=self.area,
            power=self.power,
            reach=self.reach,
            size=self.size,
        )


THEORIES: Mapping[str, Theory] = {
    "as-published": Theory(
        AreaLaw(),
        0.45,
        "plain",
        "included",
        "Ayyildiz et al., PNAS 115, 12668 (2018), Eq. 1-3",
    ),
    "open-gaps": Theory(
        AreaLaw(),
        0.45,
        "plain",
        "excluded",
        "the same, without the attraction inside the contact spots (physics page, section 1)",
    ),
    "corrected": Theory(
        AreaLaw(0.48, tips=0.022),
        0.315,
        "combined",
        "excluded",
        "area after Xu (2024); gamma, reach, power, tips by boundary elements (docs/mean-field.md)",
        power=2.0,
        reach=1.3,
        size="smooth",
        usual_terms=frozenset({"finite-size"}),
    ),
    "local": Theory(
        AreaLaw(0.48, tips=0.022),
        0.315,
        "combined",
        "widened",
        "as corrected, and the attraction beside the spots widens them (haptix.electro.widening)",
        power=2.0,
        reach=1.3,
        size="mean-gap",
        usual_terms=frozenset({"finite-size"}),
    ),
}
"""Forms of the mean field by name."""
