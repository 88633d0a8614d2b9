"""Persson's mean-field theory of one rough contact: area, mean gap, gap distribution.

All results are functions of the nominal pressure p alone, and are solved for a batch of pressures
at once. The stress variance T(q) = tau^2(1, zeta) that the waves up to q = zeta q0 add stands for
the magnification zeta. Its grid is uniform in ``ln(T / (T1 - T))``. It resolves the first waves,
where a light contact breaks up within 1e-4 of q0, and the last waves, where the gaps close.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from math import ceil, inf, log, pi, sqrt
from typing import Any, Literal, get_args

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import pad

from haptix.base.checks import eager
from haptix.base.errors import InputError
from haptix.base.threads import one_thread
from haptix.model.contact.area import AreaLaw
from haptix.model.contact.elasticity import ElasticSolid
from haptix.model.contact.finite_size import (
    SizeLaw,
    Touching,
    highest_asperity,
    highest_peak,
    once_for_equals,
    peaks_per_area,
    touching_log_pressure,
)
from haptix.model.contact.roughness import RoughnessSpectrum
from haptix.model.contact.tables import (
    Y_MAX,
    PiecewiseLinear,
    SeparationIntegral,
    UniformCubic,
    WavesIntegral,
)

LATTICE_STEP = log(10) / 24
"""Step of ln p. All tables of a contact use one lattice, so that no result depends on which other
pressures were requested. The lattice starts at the contact's rms stress and so scales with the
moduli. With 24 nodes a decade a cubic is exact within a few 1e-6."""

GapDistribution = Literal["plain", "combined", "mean-conserving"]
ContactSpots = Literal["excluded", "included", "widened"]

_NARROW = 0.05  # t below which the error of five terms of the series, t^10/11, is below 1e-14
_WAVE_NODES = 4096  # nodes of T(q); T is integrated to 1e-12, q(T) interpolated to 1e-6
_WAVE_RANGE = log(1e16)  # of ln(q/q0 - 1), from the first node to that at q1
_STRIPS = 512  # strips in magnification
_DENSE_AT, _DENSE_WIDTH = 1.5, 2.0  # of ln(T / (T1 - T)): where the strips are densest
_LAST_LOGIT = 56.0  # of ln(T / (T1 - T)): from there T1 - T is below rounding
_PER_WAVE = 0.2  # weight of ln(q/q0 - 1) against asinh(ln(T / (T1 - T))) in placing the strips
_TINY = 1e-300
_TOUCHING_RANGE, _TOUCHING_STEP = (-46.0, 2.0), log(10) / 12  # of ln p/tau
_LEAST_EXCESS = 1e-7  # q/q0 - 1 from which a separation with a reach is integrated
_SPOT_RANGE = -30.0, 40.0  # of ln (q_s/q_c)^2: at the lower end all waves count, at the upper none
_SPOT_NODES = 351  # steps of 0.2: the cubic for the share of the waves that count is exact to 1e-6
_SEPARATION_POINTS = 32  # Gauss points, at most, in each panel of one mean separation
_FIRST_SPAN, _PER_SPAN = 8.0, 2.0  # span of the first panel in ln(q/q0 - 1); points per unit of it
_FEW_BENDS = 20  # a spectrum with more has short panels, in which it is a power law: 3e-6 with 4
_MOST_NODES = 100  # a spectrum with more is averaged over rings, which keep its power
_LEAST_BAND = 3.0  # q1/q0: the theory is one of many waves, and two decades of them are usual
_Y_FLAT = 5.9  # erfc(5.9) = 7e-17: contact at this y is complete to double precision
_GAP_BINS = 600  # with the strips: I within 3e-4 for any contact, 1e-4 usually
_SERIES_END, _SERIES_TERMS = 0.25, 8  # of erf about a strip's centre: the next term is 1e-15
_ERF_IS_1 = 6.0  # from there on, in double precision
_GAP_RANGE = (1e-9, 1e2)  # bins from and to, in units of h_rms
# Nodes of the lattice that are solved together. Blocks start at fixed nodes, so that the bits of a
# node's result do not depend on the requested pressures; the arrays of a block fit the CPU's cache.
_PER_BLOCK = 24


@dataclass(frozen=True)
class Strips:
    """The contact resolved by magnification: each strip of area opens at one zeta.

    All tensors have the shape of the pressures plus one axis of strips; lengths in m.
    """

    share: Tensor
    """Share of the nominal area that opens in the strip."""
    separation_m: Tensor
    """u1, its mean gap, before it is folded at 0; zero where it is closed to double precision."""
    variance_m2: Tensor
    """s^2, the variance of the gap about u1."""


@dataclass(frozen=True)
class GapHistogram:
    """Share of the nominal area whose gap lies in each bin, open gaps only."""

    edges_m: Tensor
    """Bin edges [m], shape (bins + 1,), from 0 up; the last bin also holds everything above."""
    mass: Tensor
    """Shares, shape (..., bins); they sum to ``1 - A/A0``. Except under "plain",
    strips that are closed to double precision have no width and are left out. They are 1.2 % of A
    in light contact, but near complete contact most of the open area: use "plain" there."""

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
    # The last bin also holds all larger gaps; they are too few to matter.
    divisor = imaginary**2 + low * high
    t = (high - low) * imaginary.abs() / divisor
    # Nearly all bins are narrow compared with their gaps; there a series gives atan(t)/t.
    square = t * t
    if float(square.detach().max()) < _NARROW**2:
        ratio = 1 - square * (1 / 3 - square * (1 / 5 - square * (1 / 7 - square / 9)))
    else:
        safe = torch.where(t < 1e-3, torch.ones_like(t), t)
        ratio = torch.where(t < 1e-3, 1 - square / 3, torch.atan(safe) / safe)
    return ratio / divisor


def folded_shares(edges: Tensor, weight: Tensor, centre: Tensor, scale: Tensor) -> Tensor:
    """Return ``sum of w (erf(e s - c) + erf(e s + c))`` over strips, for every edge e.

    Most strips are much narrower or much wider than the distance to an edge. Of those in front of
    the first that is neither, the sum is a power series of the edge; behind the last, it is 2 w.

    Parameters
    ----------
    edges : Tensor, shape (edges,)
        Increasing places, above 0.
    weight, centre, scale : Tensor, shape (..., strips)
        Weights w, 0 or more; places c and 1/scale s of the strips.
    """
    with torch.no_grad():
        counts, strips = weight > 0, weight.shape[-1]
        wide = torch.where(counts, _SERIES_END / scale, inf).reshape(-1, strips).amin(0)
        narrow = torch.where(counts, (_ERF_IS_1 + centre) / scale, 0.0).reshape(-1, strips).amax(0)
        beyond = narrow.flip(0).cummax(0).values.flip(0)
        last = torch.searchsorted(-beyond, -edges)
        first = torch.searchsorted(-wide.cummin(0).values, -edges, right=True).minimum(last)
    # erf(c + a) - erf(c - a) = 4/sqrt(pi) exp(-c^2) sum of a^n H_(n-1)(c) / n! over odd n.
    # In units of the first edge, where no power overflows; exp(-c^2) is 0 long before 30.
    at, size = edges / edges[0], (scale * edges[0]).clamp(max=1.0)
    about = centre.clamp(max=30.0)
    factor = 4 / sqrt(pi) * weight * torch.exp(-(about**2)) * size
    even, odd = torch.ones_like(about), 2 * about
    below = 2 * pad(weight.flip(-1).cumsum(-1).flip(-1), (0, 1))[..., last]
    for n in range(1, 2 * _SERIES_TERMS, 2):
        below = below + at**n * pad((factor * even).cumsum(-1), (1, 0))[..., first]
        factor = factor * size**2 / ((n + 1) * (n + 2))
        even = 2 * about * odd - 2 * n * even
        odd = 2 * about * even - 2 * (n + 1) * odd
    between = []
    for edge, start, end in zip(edges, first.tolist(), last.tolist(), strict=True):
        place, middle = edge * scale[..., start:end], centre[..., start:end]
        both = torch.erf(place - middle) + torch.erf(place + middle)
        between.append((weight[..., start:end] * both).sum(-1))
    return below + torch.stack(between, -1)


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
    gap_distribution : {"plain", "combined", "mean-conserving"}
        Variance of a strip's gap: that of the shorter waves, or combined with u1 (later papers).
        Gaps are folded at 0, which raises a strip's mean; "mean-conserving" is "combined" with all
        gaps of a strip narrowed so that their mean is u1.
    device : str
        Device of the tensors. The arithmetic is float64 throughout.
    area : AreaLaw, optional
        Law of the area; by default Persson's.
    power : float
        Power of the area with which the rest of the elastic energy grows, above 1.
    reach : float
        The energy of a wave follows the area that is in contact at waves this many times shorter, 1
        or more, since those break up the contact on which the wave's stress acts.
    size : {"capped", "smooth", "mean-gap"}
        How a contact of finite size leaves that of infinite size, see `finite_size`.

    Examples
    --------
    >>> from haptix.model import HalfSpace, MeanField, RoughnessSpectrum
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
            names = ", ".join(f'"{name}"' for name in get_args(GapDistribution))
            raise InputError(f"gap_distribution: expected one of {names}, got {gap_distribution!r}")
        if spectrum.q1 < _LEAST_BAND * spectrum.q0:
            raise InputError(
                f"spectrum: expected waves from q0 to {_LEAST_BAND:g} q0 or shorter, since the "
                f"slope that decides the area comes from short waves, got {spectrum.q0:g} to "
                f"{spectrum.q1:g} /m; measure finer, or add the short waves as a self-affine tail"
            )
        if len(spectrum.wavenumber) > _MOST_NODES:
            spectrum = spectrum.of_few_nodes()
        self.spectrum = replace(
            spectrum,
            wavenumber=spectrum.wavenumber.to(device),
            density=spectrum.density.to(device),
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
        self._blocks: dict[tuple[str, int], Tensor] = {}
        self._kept_log_mean_gap: UniformCubic | None = None
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
        # Strips are densest where the gaps close (T near T1), and sparser towards both ends. A
        # layer may hold T nearly constant over decades of q; there the strips follow q.
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
        log_waves = PiecewiseLinear.through(excess, torch.stack([log_below, log_opening], -1))
        # Panels of the separation integral: the first ends where q is twice q0, the others at the
        # bends of the spectrum.
        last = float(excess[-1])
        bends = [0.0, *(float(kink) for kink in kinks)]
        ends = [*sorted(bend for bend in bends if bend < last), last]
        # With a reach of 1 tau is 0 at the first wave, which asks for more points.
        least = 6 if len(bends) <= _FEW_BENDS else 4
        if self.reach == 1:
            least = 8 if len(bends) > _FEW_BENDS else 16 if len(bends) > 4 else _SEPARATION_POINTS
        spans = [_FIRST_SPAN, *np.diff(ends)]
        counts = [min(_SEPARATION_POINTS, least + ceil(_PER_SPAN * span)) for span in spans]
        rules = (np.stack(np.polynomial.legendre.leggauss(count), -1) for count in counts)
        panels = [
            (end, torch.from_numpy(rule).to(self.device))
            for end, rule in zip(ends, rules, strict=True)
        ]
        self._over_waves = WavesIntegral(self._separation_integral, log_waves, panels)

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

    @property
    def stress_rms_pa(self) -> Tensor:
        """``tau(1, zeta1)`` [Pa], ``E* slope / sqrt(2)`` for a half-space: the scale of p."""
        return self.stress_variance.sqrt()

    @eager
    def area_fraction(self, pressure_pa: Any) -> Tensor:
        """A/A0 at full magnification, for pressures [Pa] of any shape: erf(p / tau) by Persson.

        Examples
        --------
        >>> from haptix.model import HalfSpace, RoughnessSpectrum
        >>> rough = RoughnessSpectrum.self_affine(1, 0.8, 1, 1, 1e3)
        >>> light, firm = MeanField(rough, HalfSpace(0.75, 0.5)).area_fraction([1e-2, 2e-2])
        >>> round(float(firm / light), 1)  # in proportion to the load while it is light
        2.0
        """
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
            # Below the table all waves count; above it T_s is proportional to q_s^-2.
            inside = self._log_spot_share(at.clamp(low, high))
            y = y * torch.exp((at.clamp(min=high) - high - inside) / 2)
        return y

    def highest_asperity(self, apparent_area_m2: Tensor) -> Tensor:
        """Height [m] of the highest asperity, where an unloaded contact rests, for A0 [m^2]."""
        if self._peaks_per_m2 is None:
            return highest_asperity(self._h_rms_m, self.spectrum.q_rolloff, apparent_area_m2)
        of_area = partial(highest_peak, self._h_rms_m, self._peaks_per_m2)
        return once_for_equals(of_area, apparent_area_m2)

    def touching(self, height_m: Tensor, log_mean_gap: UniformCubic | None = None) -> Touching:
        """Finite size of states, from the height [m] of their highest asperity, of any shape.

        A caller who needs it often passes the table of `log_mean_gap`.

        Parameters
        ----------
        height_m : Tensor
            Height [m] of the highest asperity above the mean plane, of any shape.
        log_mean_gap : UniformCubic, optional
            The table of the method `log_mean_gap`, where it is needed often.
        """
        table = log_mean_gap or self.log_mean_gap()
        log_pressure = once_for_equals(partial(touching_log_pressure, table), torch.log(height_m))
        return Touching(log_pressure, self.size)

    @one_thread()
    def log_mean_gap(self) -> UniformCubic:
        """Tabulate ln of the mean gap [m] against ln p [Pa], down to the lightest contacts."""
        if self._kept_log_mean_gap is not None:
            return self._kept_log_mean_gap
        low, high = _TOUCHING_RANGE
        nodes = torch.arange(low, high, _TOUCHING_STEP, dtype=torch.float64, device=self.device)
        at = torch.log(self.stress_rms_pa) + nodes
        gap = torch.log(self.mean_gap(torch.exp(at)).clamp(min=_TINY))
        table = UniformCubic.through(at[0], _TOUCHING_STEP, gap)
        if not gap.requires_grad:
            self._kept_log_mean_gap = table
        return table

    def log_lattice(self, first: int, last: int) -> Tensor:
        """Ln p [Pa] of the lattice's nodes `first` to `last`, both included.

        Parameters
        ----------
        first, last : int
            Numbers of the first and last node; both are included.
        """
        nodes = torch.arange(first, last + 1, dtype=torch.float64, device=self.device)
        return torch.log(self.stress_rms_pa) + nodes * LATTICE_STEP

    def lattice_mass(self, first: int, last: int) -> Tensor:
        """Masses of `gap_histogram` at nodes of `log_lattice`, shape (nodes, bins).

        Parameters
        ----------
        first, last : int
            Numbers of the first and last node; both are included.
        """
        return self._on_lattice("mass", lambda p: self.gap_histogram(p).mass, first, last)

    def lattice_mean_gap(self, first: int, last: int) -> Tensor:
        """Mean gap [m] at nodes of `log_lattice`.

        Parameters
        ----------
        first, last : int
            Numbers of the first and last node; both are included.
        """
        return self._on_lattice("mean gap", self.mean_gap, first, last)

    def _on_lattice(
        self, what: str, solve: Callable[[Tensor], Tensor], first: int, last: int
    ) -> Tensor:
        if self.stress_variance.requires_grad:  # a graph must not outlive its solve
            return solve(torch.exp(self.log_lattice(first, last)))
        low, high = first // _PER_BLOCK, last // _PER_BLOCK
        for block in range(low, high + 1):
            if (what, block) not in self._blocks:
                start = block * _PER_BLOCK
                nodes = torch.exp(self.log_lattice(start, start + _PER_BLOCK - 1))
                self._blocks[what, block] = solve(nodes)
        blocks = torch.cat([self._blocks[what, block] for block in range(low, high + 1)])
        return blocks[first - low * _PER_BLOCK : last - low * _PER_BLOCK + 1]

    @eager
    @one_thread()
    def mean_gap(self, pressure_pa: Any) -> Tensor:
        """Mean separation [m] of the two surfaces, for pressures [Pa] of any shape.

        Examples
        --------
        >>> from haptix.model import HalfSpace, RoughnessSpectrum
        >>> rough = RoughnessSpectrum.self_affine(1, 0.8, 1, 1, 1e3)
        >>> light, firm = MeanField(rough, HalfSpace(0.75, 0.5)).mean_gap([1e-2, 2e-2])
        >>> bool(firm < light)
        True
        """
        pressure = self._pressures(pressure_pa)
        return self._separation(pressure, torch.zeros_like(pressure), self.stress_variance)

    @eager
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

        Examples
        --------
        >>> from haptix.model import HalfSpace, RoughnessSpectrum
        >>> rough = RoughnessSpectrum.self_affine(2e-6, hurst=0.8, q0=1e3, q_rolloff=1e4, q1=1e7)
        >>> contact = MeanField(rough, HalfSpace(youngs_modulus_pa=1e6, poisson_ratio=0.5))
        >>> thin, thick = (contact.inverse_square_gap(1e4, h0_m=h0_m) for h0_m in (1e-7, 1e-6))
        >>> bool(thin > thick)
        True
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

    @eager
    @one_thread()
    def gap_density(self, pressure_pa: Any, gap_m: Any) -> Tensor:
        """P(u) [1/m] of the open gaps; pressures [Pa] and gaps [m] broadcast.

        The contact spots' delta function at u = 0 is left out: the integral is ``1 - A/A0``.

        Parameters
        ----------
        pressure_pa : float or Tensor
        gap_m : float or Tensor
            Gaps u [m], above 0; they broadcast with the pressures.

        Examples
        --------
        >>> import torch
        >>> from haptix.model import HalfSpace, RoughnessSpectrum
        >>> rough = RoughnessSpectrum.self_affine(2e-6, hurst=0.8, q0=1e3, q_rolloff=1e4, q1=1e7)
        >>> contact = MeanField(rough, HalfSpace(youngs_modulus_pa=1e6, poisson_ratio=0.5))
        >>> near, far = contact.gap_density(1e4, torch.tensor([1e-6, 1e-4], dtype=torch.float64))
        >>> bool(near > far)
        True
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
    @eager
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
        below = folded_shares(self.gap_edges_m[1:-1], weight, centre, scale)
        none, all_ = torch.zeros_like(pressure)[..., None], 2 * weight.sum(-1, keepdim=True)
        return GapHistogram(self.gap_edges_m, torch.cat([none, below, all_], -1).diff(dim=-1))

    def strips(self, pressure_pa: Tensor) -> Strips:
        """Resolve the contact by magnification, for pressures [Pa] of any shape."""
        pressure = pressure_pa[..., None]
        total = self.stress_variance
        # The strips reach from the magnification at which contact is still complete to the last
        # wave.
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
        # u1 = ubar + A dubar/dA = d(A ubar)/dA. As a difference over the strip it conserves the
        # mean.
        lost = -(area * separation).diff(dim=-1)
        empty = share <= 0
        u1 = torch.where(empty, torch.zeros_like(lost), lost / share.masked_fill(empty, 1.0))
        u1 = u1.clamp(min=0.0)
        rough = self.spectrum.moment(1, self._wavenumber(torch.cat([logit, logit[..., -1:]], -1)))
        rough = (rough[..., 1:] + rough[..., :-1]) / 2
        share = share.clamp(min=0.0)
        if self.gap_distribution == "plain":
            return Strips(share, u1, rough)
        closed = u1 <= 0
        mean = u1.masked_fill(closed, 1.0)
        both = 1 / (1 / rough + 1 / mean**2)
        if self.gap_distribution == "mean-conserving":
            # Mean of a Gaussian that is folded at 0, over its centre.
            steep = mean / (2 * both).sqrt()
            folded = torch.erf(steep) + torch.exp(-steep * steep) / (sqrt(pi) * steep)
            u1, both = u1 / folded, both / folded**2
        return Strips(share, u1, both.masked_fill(closed, 0.0))

    def _separation(self, pressure: Tensor, variance: Tensor, rest: Tensor) -> Tensor:
        """Mean gap [m] at the magnification T = `variance`, from the local `pressure` [Pa].

        ``ubar = (2/sqrt(pi)) int dtau J(p/tau) / (q E*)``, for tau from 0 to ``sqrt(T1 - T)``;
        `rest` is T1 - T. Where J is not 0, tau is at least a sixth of sqrt(T). So the integral is
        smooth in ``w = ln(q/q0 - 1)`` for any layers of the solid.
        """
        rest = rest.expand_as(pressure)
        start = (pressure / Y_MAX) ** 2
        open_ = rest > start
        above = torch.where(open_, rest - start, torch.ones_like(rest))
        low = self._log_excess_at(variance + start, above)
        if self.reach > 1:  # start where the shorter waves reach that stress, not before this wave
            low = torch.log(((1 + torch.exp(low)) / self.reach - 1).clamp(min=_LEAST_EXCESS))
            whole = torch.where(open_, rest, torch.ones_like(rest))
            low = torch.maximum(low, self._log_excess_at(variance.clamp(min=_TINY), whole))
        total = self._over_waves(pressure, variance, low)
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
        """Return a float64 or complex128 tensor of a value that is a tensor or that numpy reads."""
        try:
            tensor = value if isinstance(value, Tensor) else torch.as_tensor(np.asarray(value))
            wide = torch.complex128 if tensor.is_complex() else torch.float64
            return tensor.to(self.device, wide)
        except (TypeError, ValueError, RuntimeError):
            raise InputError(f"{name}: expected numbers, got {value!r}") from None


def check_contact_spots(contact_spots: str) -> None:
    """Raise `InputError` unless `contact_spots` is "excluded", "included" or "widened"."""
    if contact_spots not in get_args(ContactSpots):
        raise InputError(
            f'contact_spots: expected "excluded", "included" or "widened", got {contact_spots!r}'
        )
