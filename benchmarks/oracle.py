"""A slow, independent solution of one state of the contact model, in numpy, scipy and mpmath.

It follows the equations of the mean field directly: ``tau^2`` by the trapezoidal rule on very many
waves, J by quadrature, the separation by Simpson's rule in ln(q/q0 - 1), I as the integral of
``P(u)/|u + h0|^2`` over the gaps, a layer's response from its textbook form in 40 digits, and the
equilibrium by the secant method on I itself, with no table in between. The terms: both gap
distributions, finite size by a root of the mean gap, plasticity by mirror images in 50 digits, the
skin's and a leaking gap's impedance in complex numbers, gaps held at what they bear, the body's
impedance in series, and the critical-voltage formula. The theories are the published one and the
corrected one of docs/mean-field.md, whose area is a root at every magnification, and what
attraction does beside the spots. It shares no code with the package.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from math import erf, pi, sqrt

import mpmath
import numpy as np
from scipy import special
from scipy.integrate import cumulative_simpson, quad, simpson
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.optimize import brentq

EPS0 = 8.8541878128e-12
LIGHT = 31.0  # a contact that carries more than this times its load counts as snapped in
LONG_WAVES = 16  # times the roll-off: shorter waves add nothing to the highest peak
CLOSED = 5.6  # p/tau beyond which the combined distribution drops a strip, as the package does


@dataclass(frozen=True)
class Theory:
    """A mean field by the numbers of docs/mean-field.md."""

    gamma: float = 0.45
    power: int = 3
    slowing: float = 1.0
    """g, by which stress diffuses more slowly as area is lost."""
    tips: float = 0.0
    """c, of the waves that do not spread the stress inside a spot."""
    reach: float = 1.0
    """How many times shorter the waves are that have broken a wave's contact up."""
    combined: bool = False
    conserving: bool = False
    """Whether a strip's combined gaps are narrowed to the mean that they had before the fold."""
    smooth: bool = False
    """Whether a finite size is smooth and that of the highest peak, or capped."""

    def stretched(self, t: float) -> float:
        """``y = t sqrt(g + (1 - g) erf t)``, of which A/A0 is erf t."""
        return t * sqrt(self.slowing + (1 - self.slowing) * erf(t))

    def argument(self, y: float) -> float:
        """Return t at y."""
        if self.slowing == 1:
            return y
        ends = 0.999 * y, 1.001 * y / sqrt(self.slowing)  # rounding may move the root past either
        return float(brentq(lambda t: self.stretched(t) - y, *ends, xtol=1e-300))

    def arguments(self, y: np.ndarray) -> np.ndarray:
        return np.array([self.argument(one) for one in y.tolist()])


PUBLISHED = Theory()
CORRECTED = Theory(0.315, 2, 0.48, 0.022, 1.3, combined=True, smooth=True)
LOCAL = replace(CORRECTED, conserving=True)


@dataclass(frozen=True)
class Solid:
    """Young's moduli [Pa], Poisson ratios and the layer's thickness [m]; no bulk: half-space."""

    modulus: float
    poisson: float
    thickness: float = 0.0
    bulk: float | None = None
    bulk_poisson: float = 0.5

    def effective(self, q: np.ndarray) -> np.ndarray:
        flat = self.modulus / (1 - self.poisson**2)
        if self.bulk is None:
            return np.full_like(q, flat)
        # ln E* is smooth in ln q: on steps of 0.02 the spline is right to 1e-8.
        ends = np.log(q.min()) - 0.1, np.log(q.max()) + 0.1
        at = np.linspace(*ends, 20 + int((ends[1] - ends[0]) / 0.02))
        with mpmath.workdps(40):
            soft = [float(mpmath.log(self._response(mpmath.exp(t)))) for t in at.tolist()]
        return flat * np.exp(-CubicSpline(at, soft)(np.log(q)))

    def _response(self, q: mpmath.mpf) -> mpmath.mpf:
        """S(q d) as printed (physics page, section 3); 40 digits survive the cancellation."""
        x = q * self.thickness
        if x > 30:
            return mpmath.mpf(1)
        nu0, nu1 = mpmath.mpf(self.poisson), mpmath.mpf(self.bulk_poisson)
        k = (self.modulus / (1 + nu0)) / (self.bulk / (1 + nu1))
        m = (k - 1) / (k + 3 - 4 * nu0)
        n = 1 - 4 * (1 - nu0) / (1 + k * (3 - 4 * nu1))
        e = mpmath.exp(-2 * x)
        above = 1 + 4 * m * x * e - m * n * e**2
        return above / (1 - (m + n + 4 * m * x**2) * e + m * n * e**2)


@dataclass(frozen=True)
class SelfAffine:
    """Spectrum C(q): constant from q0 to the roll-off, then ``q^(-2(1+H))`` to q1; h_rms [m]."""

    h_rms: float
    hurst: float
    q0: float
    rolloff: float
    q1: float

    def __call__(self, q: np.ndarray) -> np.ndarray:
        qr, two_h = self.rolloff, 2 * self.hurst
        whole = (qr**2 - self.q0**2) / 2 + qr**2 * (1 - (self.q1 / qr) ** -two_h) / two_h
        level = self.h_rms**2 / (2 * pi * whole)
        return level * np.maximum(q / qr, 1.0) ** (-2 - two_h)

    def highest_asperity(self, apparent_area: float) -> float:
        """``h_rms sqrt(2 ln N)`` [m] with N squares of the roll-off wavelength, two at least."""
        number = apparent_area * (self.rolloff / (2 * pi)) ** 2
        return self.h_rms * sqrt(2 * np.log(max(number, 2.0)))

    def highest_peak(self, apparent_area: float) -> float:
        """Mean height [m] of the highest point of a random surface (docs/mean-field.md)."""
        ends: tuple[float, ...] = (self.q0, min(max(self.q0, self.rolloff), self.q1))
        ends += (min(LONG_WAVES * self.rolloff, self.q1),)
        slope = sum(
            quad(lambda t: 2 * pi * np.exp(4 * t) * self(np.exp(t)), *np.log(pair), epsrel=1e-10)[0]
            for pair in pairwise(ends)
        )
        k = apparent_area * slope / (2 * self.h_rms**2 * (2 * pi) ** 1.5)
        # k x exp(-x^2/2) = 1 has no root for small k: 1 + k x in place of k x.
        x = brentq(lambda x: x * x / 2 - np.log1p(k * x), min(k, 1), 2 + 2 * np.log1p(k))
        return float(self.h_rms * (x + np.euler_gamma * x / (1 + x * x)))


@dataclass(frozen=True)
class State:
    """Pressure p0 [Pa], amplitude [V], complex h0 [m], and the strength of the attraction.

    `touching` [Pa] is the pressure at which the infinite contact's mean gap is that of the highest
    asperity; 0 without finite size. Gaps that are
    `held` have the field that they bear at most. A `body` [F] stands in series with `fingers`
    contacts of apparent `area` [m^2] each, whose gaps hold a `medium` of that permittivity.
    """

    applied: float
    voltage: float
    h0: complex
    spots: bool = False
    touching: float = 0.0
    held: bool = False
    body: float | None = None
    fingers: int = 1
    area: float = 0.0
    medium: complex = 1.0

    @property
    def strength(self) -> float:
        return EPS0 * self.voltage**2 / 4


def thickness(
    h0: float,
    frequency: float,
    skin: float,
    table: tuple[tuple[float, ...], ...],
    gap_resistivity: float | None = None,
) -> complex:
    """``eps_g (h0 + d2/eps2)`` [m] with `skin` d2; `table` has f, eps and rho of the skin."""
    omega = 2 * pi * frequency
    f, *columns = np.log(table)
    # A row held on either side: scipy's slopes at the ends are 0 then.
    f = np.concatenate([[f[0] - 1], f, [f[-1] + 1]])
    held = [np.concatenate([column[:1], column, column[-1:]]) for column in columns]
    at = np.clip(np.log(frequency), f[0], f[-1])
    eps, rho = (np.exp(PchipInterpolator(f, column)(at)) for column in held)
    eps2 = eps + 1j / (omega * EPS0 * rho)
    return complex((h0 + skin / eps2) * leaking(frequency, gap_resistivity))


def leaking(frequency: float, resistivity: float | None) -> complex:
    """``eps_g = 1 + i/(w eps0 rho_g)`` of a gap with moisture."""
    return 1 + (0j if resistivity is None else 1j / (2 * pi * frequency * EPS0 * resistivity))


def apparent_area(force: float, at_1n: float, exponent: float) -> float:
    """Area [m^2] under a finger that presses with a force [N]."""
    return float(np.exp(np.log(at_1n) + exponent * np.log(force)))


def breaks_down(voltage: float, h0: complex, permittivity: float, strength: float) -> bool:
    """Whether a gap (350 V/um if narrow; 327 V at 7.5 um, by Paschen) or insulator breaks down."""
    field = voltage / abs(h0)
    paschen = voltage * 7.5e-6 / abs(7.5e-6 + h0)
    return field > 350e6 or paschen > 327 or field / permittivity > strength


def field_borne(gap: np.ndarray) -> np.ndarray:
    """Field [V/m] that dry gaps [m] bear: 350 V/um, or Paschen's law where that is less."""
    with np.errstate(divide="ignore", invalid="ignore"):
        paschen = 327 / 7.5e-6 / (1 + np.log(gap / 7.5e-6))
    return np.where((paschen > 0) & (paschen < 350e6), paschen, 350e6)


def held_square(gap: np.ndarray, h0: complex, voltage: float) -> np.ndarray:
    """Squared field of held gaps over that of the voltage: ``min(1/|u + h0|^2, (E_b/V)^2)``."""
    return np.minimum(abs(gap + h0) ** -2, (field_borne(gap) / voltage) ** 2)


def voltage_left(contact: complex, body: float, fingers: int) -> complex:
    """Share of a voltage over contacts side by side, in series with a body; capacitances [F]."""
    impedance = 1 / (fingers * contact)
    return impedance / (impedance + 1 / body)


def two_walls(mean: float, spread: float) -> tuple[float, float]:
    """Elastic and plastic share of a stress that diffuses between absorbing walls at 0 and 1.

    It sums mirror images of the Gaussian without walls. The load that the elastic area does not
    carry has been absorbed by the wall at 1.
    """
    if mean >= 1:
        return 0.0, 1.0
    if spread > 4:  # of the elastic share exp(-(4 pi)^2/2) = 1e-34 is left
        return 0.0, mean
    with mpmath.workdps(50):
        m, s = mpmath.mpf(mean), mpmath.mpf(spread)
        area = load = mpmath.mpf(0)
        reach = 2 + int(8 * s)  # the images left out are 16 spreads away: exp(-16^2/2) = 1e-56
        for k in range(-reach, reach + 1):
            for sign, centre in ((1, 2 * k + m), (-1, 2 * k - m)):
                low, high = -centre / (mpmath.sqrt(2) * s), (1 - centre) / (mpmath.sqrt(2) * s)
                share = (mpmath.erf(high) - mpmath.erf(low)) / 2
                peaks = mpmath.exp(-(high**2)) - mpmath.exp(-(low**2))
                area += sign * share
                load += sign * (centre * share - s / mpmath.sqrt(2 * mpmath.pi) * peaks)
        return float(area), float(m - load)


def separation_integral(theory: Theory) -> tuple[np.ndarray, np.ndarray]:
    """Return values of ln y, and ln J there.

    ``J = int_y^inf [gamma + n (1 - gamma) A^(n-1)] exp(-t^2) dt/x(t)``, A = erf t the area at x.
    """
    log_y = np.linspace(np.log(1e-9), np.log(6.0), 1501)
    rest = theory.power * (1 - theory.gamma)

    def integrand(log_t: float) -> float:
        t = np.exp(log_t)
        energy = theory.gamma + rest * erf(t) ** (theory.power - 1)
        return energy * np.exp(-t * t) * t / theory.stretched(t)

    ends = np.log(theory.arguments(np.exp(log_y)))
    cells = [quad(integrand, a, b)[0] for a, b in pairwise(ends)]
    tail = quad(integrand, ends[-1], np.log(9.0))[0]
    return log_y, np.log(np.cumsum([tail, *cells[::-1]])[::-1])


class Oracle:
    """Area, separation, attraction and equilibrium of one contact.

    `fineness` multiplies the number of strips, depths and gaps; the change that it causes is the
    oracle's own error. Combined gaps give every strip the width ``1/s^2 = 1/h_rms^2(q) + 1/u1^2``;
    strips whose gap is zero to double precision have none and are dropped, as in the package
    (`keep_closed` counts them as gaps of zero instead). With a `hardness` [Pa] the area yields.
    """

    WAVES = 100_001

    def __init__(
        self,
        rough: SelfAffine,
        solid: Solid,
        theory: Theory = PUBLISHED,
        fineness: float = 1.0,
        hardness: float | None = None,
        keep_closed: bool = False,
    ) -> None:
        self.theory, self.hardness, self.keep_closed = theory, hardness, keep_closed
        self.strips, self.depth, self.places = (
            int(n * fineness) // 2 * 2 + 1 for n in (500, 400, 500)
        )
        q0, q1 = rough.q0, rough.q1
        x = np.linspace(np.log(1e-18), np.log(q1 / q0 - 1), self.WAVES)
        # The roll-off, and what lies a reach before it and before the end.
        bends = {rough.rolloff, rough.rolloff / theory.reach, q1 / theory.reach}
        self.bends = [np.log(q / q0 - 1) for q in sorted(bends) if q0 < q < q1]
        x = np.unique(np.append(x, self.bends))
        ratio = np.exp(x)
        q = np.clip(q0 * (1 + ratio), q0, q1)
        modulus = solid.effective(q)
        added = pi * q**3 * rough(q) * modulus**2 * q0 * ratio
        cells = (added[1:] + added[:-1]) / 2 * np.diff(x)
        below = added[0] + np.concatenate([[0.0], np.cumsum(cells)])
        above = np.cumsum(cells[::-1])[::-1]  # from q1 down, without cancellation
        self.total = below[-1]
        self.logit = np.log(below[:-1] / above)
        heights = 2 * pi * q * rough(q) * q0 * ratio
        cells = (heights[1:] + heights[:-1]) / 2 * np.diff(x)
        self.short_waves = np.concatenate([np.cumsum(cells[::-1])[::-1], [0.0]])
        self.x, self.log_below = x, np.log(below)
        self.log_opening = np.log(added / (q * modulus))  # dT/dx over q E*
        self.tau = sqrt(self.total)
        self.wave, self.stress = np.sqrt(q[1:] * q[:-1]), np.diff(below, prepend=0.0)[1:]
        self.log_y, self.log_j = separation_integral(theory)

    def area_fraction(self, pressure: float) -> float:
        argument = self.theory.argument(pressure / self.spread(pressure))
        if self.hardness is None:
            return erf(argument)
        # erf t is what a wall at 0 leaves of a Gaussian of standard deviation p/t/sqrt(2).
        return sum(two_walls(*np.array([pressure, pressure / argument / sqrt(2)]) / self.hardness))

    def spread(self, pressure: float) -> float:
        """``sqrt(int dT / (1 + (q_s/q)^2))`` [Pa], tau but for waves longer than a spot."""
        if not self.theory.tips:
            return self.tau
        second, fourth = (float((self.stress * self.wave**-n).sum()) for n in (2.0, 4.0))
        curved = second / fourth
        spot = self.theory.tips * curved * (pressure**2 / (second * curved)) ** (-1 / 3)
        return sqrt(float((self.stress / (1 + spot / self.wave**2)).sum()))

    def mean_gap(self, pressure: float, touching: float = 0.0) -> float:
        at = np.array([self.of_gap(pressure, touching)])
        return float(self._separation(at, np.zeros(1), np.array([self.total]))[0])

    def of_gap(self, pressure: float, touching: float) -> float:
        """Pressure [Pa] at which an infinite contact has the mean gap of a finite one."""
        if self.theory.smooth:
            return (pressure ** (2 / 3) + touching ** (2 / 3)) ** 1.5
        return max(pressure, touching)

    def of_pull(self, pressure: float, touching: float) -> float:
        """Pressure [Pa] at which an infinite contact has the attraction of a finite one."""
        at = self.of_gap(pressure, touching)
        return sqrt(pressure * at) if self.theory.smooth else at

    def height(self, rough: SelfAffine, apparent_area: float) -> float:
        """Height [m] of the highest asperity by the theory."""
        peak = rough.highest_peak if self.theory.smooth else rough.highest_asperity
        return peak(apparent_area)

    def touching_pressure(self, height: float) -> float:
        """Pressure [Pa] at which the mean gap equals a height [m]."""
        scale = np.log(self.tau)
        return float(
            np.exp(
                brentq(
                    lambda t: self.mean_gap(np.exp(t)) - height,
                    scale - 60,
                    scale + 1.7,
                    xtol=1e-10,
                )
            )
        )

    def _separation(self, pressure: np.ndarray, before: np.ndarray, rest: np.ndarray) -> np.ndarray:
        """Mean gap where waves of variance `before` are seen and those of `rest` are not yet."""
        # In x = ln(q/q0 - 1), not in tau: over a soft layer on a stiff base tau hardly changes
        # where q, and with it the compliance, runs over decades.
        start = (pressure / 6.0) ** 2
        is_open = rest > start
        left = np.where(is_open, rest - start, 1.0)
        low = np.interp(np.log((before + start) / left), self.logit, self.x[:-1])
        if self.theory.reach > 1:  # waves that much longer open too, but none that is seen already
            low = np.log(np.maximum((1 + np.exp(low)) / self.theory.reach - 1, 1e-9))
            with np.errstate(divide="ignore"):
                logit = np.log(before / np.where(is_open, rest, 1.0))
            low = np.maximum(low, np.interp(logit, self.logit, self.x[:-1]))
        # From bend to bend: Simpson's rule is inaccurate across them.
        ends = [low, *(np.maximum(low, bend) for bend in self.bends), np.full_like(low, self.x[-1])]
        parts = [self._panel(pressure, before, start, *pair) for pair in pairwise(ends)]
        return np.where(is_open, sum(parts), 0.0)

    def _panel(
        self,
        pressure: np.ndarray,
        before: np.ndarray,
        start: np.ndarray,
        low: np.ndarray,
        high: np.ndarray,
    ) -> np.ndarray:
        span = high - low
        x = low[:, None] + span[:, None] * np.linspace(0, 1, self.depth)
        shorter = np.log(self.theory.reach * (1 + np.exp(x)) - 1) if self.theory.reach > 1 else x
        seen = np.exp(np.interp(shorter, self.x, self.log_below)) - before[:, None]
        tau = np.sqrt(np.maximum(seen, start[:, None]))
        log_y = np.log(pressure)[:, None] - np.log(tau)
        # J -> gamma ln(1/y) / sqrt(g) below the table's end.
        slope = self.theory.gamma / sqrt(self.theory.slowing)
        beyond = slope * np.maximum(self.log_y[0] - log_y, 0.0)
        j = np.exp(np.interp(log_y, self.log_y, self.log_j)) + beyond
        integrand = np.exp(np.interp(x, self.x, self.log_opening)) / (2 * tau) * j
        return 2 / sqrt(pi) * simpson(integrand, dx=1 / (self.depth - 1), axis=1) * span

    def gap_attraction(self, pressure: float, h0: complex) -> float:
        """``<1/|u + h0|^2>`` of the open gaps."""
        return self.gap_mean(pressure, h0, lambda u: abs(u + h0) ** -2).real

    def capacitance(self, pressure: float, state: State) -> complex:
        """``eps0 eps_g A0 <1/(u + h0)>`` [F] of gaps and spots."""
        near = self.of_pull(pressure, state.touching)
        gaps = self.gap_mean(near, state.h0, lambda u: 1 / (u + state.h0))
        return EPS0 * state.medium * state.area * (gaps + self.area_fraction(pressure) / state.h0)

    def gap_mean(
        self, pressure: float, h0: complex, of_gap: Callable[[np.ndarray], np.ndarray]
    ) -> complex:
        """Mean of a function of the gap over the open gaps; smooth below 1e-6 h0."""
        u, density, closed = self.gaps(pressure, 1e-6 * abs(h0))
        kernel = of_gap(u)
        return complex(closed * kernel[0] + simpson(density * kernel * u, x=np.log(u)))

    def gaps(self, pressure: float, finest: float) -> tuple[np.ndarray, np.ndarray, float]:
        """Gaps [m] from the finest on, their density, and the share of those below it."""
        total = self.total
        start = min((pressure / 6.0) ** 2, total / 4)
        # First half of the magnifications graded towards q0, second towards q1.
        early = np.geomspace(start, total / 2, self.strips)
        late = np.geomspace(total / 2, total * 1e-12, self.strips)
        before = np.concatenate([early, total - late[1:]])
        rest = np.concatenate([total - early, late[1:]])
        y = self.theory.arguments(pressure / np.sqrt(before))
        area = special.erf(y)
        parts = 24
        ubar = np.concatenate(
            [
                self._separation(*some)
                for some in zip(
                    np.array_split(pressure / area, parts),
                    np.array_split(before, parts),
                    np.array_split(rest, parts),
                    strict=True,
                )
            ]
        )
        opened = np.where(y[1:] > 0.5, np.diff(special.erfc(y)), -np.diff(area))
        u1 = np.maximum(-np.diff(area * ubar), 0.0) / np.maximum(opened, 1e-300)
        middle = np.log(before[1:] / rest[1:] * before[:-1] / rest[:-1]) / 2
        s = np.sqrt(np.interp(middle, self.logit, self.short_waves[:-1]))
        if self.theory.combined:
            is_open = (rest[:-1] > (pressure / area[:-1] / CLOSED) ** 2) & (u1 > 0)
            if self.keep_closed:
                u1 = np.maximum(u1, 1e-3 * finest)
            else:
                opened, u1, s = opened[is_open], u1[is_open], s[is_open]
            s = s * u1 / np.hypot(s, u1)
            if self.theory.conserving:
                mean = u1 * special.erf(u1 / (sqrt(2) * s))
                mean += sqrt(2 / pi) * s * np.exp(-((u1 / s) ** 2) / 2)
                u1, s = u1 * u1 / mean, s * u1 / mean
        if len(s) == 0:  # complete contact
            return np.array([finest, 2 * finest]), np.zeros(2), 0.0
        u = np.geomspace(finest, (u1 + 8 * s).max(), self.places)
        density = np.zeros_like(u)
        for some in np.array_split(np.arange(len(s)), parts):
            peaks = sum(
                np.exp(-(((u[:, None] - side * u1[some]) / s[some]) ** 2) / 2) for side in (1, -1)
            )
            density += (peaks * opened[some] / (sqrt(2 * pi) * s[some])).sum(1)
        # Gaps below the first node attract as a gap of zero does, to 1e-6.
        width = sqrt(2) * s
        below = special.erf((u[0] - u1) / width) + special.erf((u[0] + u1) / width)
        return u, density, float((opened * below).sum()) / 2

    def attraction(self, pressure: float, state: State) -> float:
        """``<1/|u + h0|^2>`` that loads the contact."""
        left = self.left(pressure, state)
        # Gaps are held by the voltage at rest, as the package does (docs/terms.md).
        volts = state.voltage * (self.left(state.applied, state) if state.held else left)

        def squared(u: np.ndarray) -> np.ndarray:
            return held_square(u, state.h0, volts) if state.held else abs(u + state.h0) ** -2

        total = self.gap_mean(self.of_pull(pressure, state.touching), state.h0, squared).real
        if state.spots:
            total += self.area_fraction(pressure) / abs(state.h0) ** 2
        return total * left**2

    def left(self, pressure: float, state: State) -> float:
        """Share of the voltage that a contact of this pressure has."""
        if state.body is None:
            return 1.0
        return abs(voltage_left(self.capacitance(pressure, state), state.body, state.fingers))

    def equilibrium(self, state: State, near: float) -> float:
        """Root of ``p = p0 + eps0 V^2 I(p)/4`` by the secant method from a pressure near it."""
        if state.strength == 0:
            return state.applied

        def excess(p: float) -> float:
            return p - state.applied - state.strength * self.attraction(p, state)

        before, now = near, near * 1.003
        low, high = excess(before), excess(now)
        for _ in range(12):
            step = high * (now - before) / (high - low)
            before, low, now = now, high, max(now - step, state.applied)
            if abs(now - before) < 1e-7 * now:
                break
            high = excess(now)
        return now

    def beside_the_spots(
        self, pressure: float, applied: float, h0: complex
    ) -> tuple[float, float, float]:
        """``(p_A - p0)/c``, the gaps' share of it and p_u [Pa] of the theory "local", at p_A.

        By the four equations of docs/mean-field.md, of a contact without finite size.
        """
        u, density, closed = self.gaps(pressure, 1e-6 * abs(h0))
        x, mass, step = np.log(u), density * u, 0.1

        def ranks(p: float) -> tuple[np.ndarray, np.ndarray]:
            """Share of the area below each gap, and above: each is exact where it is small."""
            gap, at, tiny = self.gaps(p, u[0])
            part = np.interp(u, gap, at, right=0.0) * u
            below = np.concatenate([[0.0], cumulative_simpson(part, x=x)])
            above = np.concatenate([cumulative_simpson(part[::-1], x=-x[::-1])[::-1], [0.0]])
            return self.area_fraction(p) + tiny + below, above

        rank = ranks(pressure)[0]
        fall = np.zeros_like(u)  # per ln p, by differences of fourth order
        for steps, weight in ((1, 8), (-1, -8), (2, -1), (-2, 1)):
            below, above = ranks(pressure * np.exp(steps * step))
            fall += weight / 12 / step * np.where(rank < 0.5, below, -above)
        work = np.maximum(fall, 0.0) * u
        work = np.minimum(work / simpson(work, x=x), 4 * mass)
        reach = np.divide(work, mass, out=np.zeros_like(mass), where=mass > 1e-12 * mass.max())
        place = (rank - self.area_fraction(pressure)) / (0.03 * self.area_fraction(pressure))
        anchor = reach[np.searchsorted(place, 1.0)]  # below it, the root of the distance
        place[0] /= 2  # stands for all gaps below the finest
        reach = np.where(place < 1, anchor * np.sqrt(np.clip(place, 0.0, 1.0)), reach)
        spots, angle = pi / 2 * self.area_fraction(pressure), pi / 2 * np.minimum(rank, 1.0)
        beyond = np.arccos(np.clip(np.cos(angle) / np.cos(spots), -1.0, 1.0)) - (angle - spots)
        edge = np.diff(2 / pi * beyond, prepend=0.0)  # the first of gaps below the finest
        rest = self.mean_gap(pressure)

        def sums(lift: float) -> tuple[float, float, float]:
            pull = abs(u + lift * reach / 2 + h0) ** -2
            gaps = closed * pull[0] + float(simpson(mass * pull, x=x))
            beside = float(edge[0] * pull[0] + (edge[1:] * (pull[1:] + pull[:-1]) / 2).sum())
            return gaps, float(simpson(work * pull, x=x)), beside

        near = sums(0.0)[2]

        def outcome(lift: float) -> tuple[float, float, float]:
            gaps, moved, lifted = sums(lift)
            z = sqrt(max(near / lifted, 1.0)) - 1
            total = gaps + near / (1 + z * z / (1 + z)) ** 2
            left = min((applied + (pressure - applied) * moved / total) / pressure, 1.0)
            return total, gaps, pressure * np.exp(-(1 - left - np.log(left)) / 2)

        def excess(lift: float) -> float:
            return self.mean_gap(outcome(lift)[2]) - rest - lift

        return outcome(float(brentq(excess, 0.0, self.mean_gap(applied) - rest, rtol=1e-6)))

    def nothing_below(self, state: State, root: float, shares: tuple[float, ...]) -> bool:
        """Whether attraction exceeds the contact's pressure at these shares of a root."""
        between = state.applied * (root / state.applied) ** np.array(shares)
        return all(state.strength * self.attraction(p, state) >= p - state.applied for p in between)

    def critical_voltage(self, reference: float, h0: complex, spots: bool = False) -> float:
        """``Vc = 2 / sqrt(eps0 Lambda)``, Lambda = I/p at a reference pressure."""
        proportion = self.gap_attraction(reference, h0) / reference
        if spots:
            proportion += self.light_area(reference) / reference / abs(h0) ** 2
        return 2 / sqrt(EPS0 * max(proportion, 1e-300))  # complete contact: no attraction

    def light_area(self, pressure: float) -> float:
        """A/A0 at a pressure if the contact were light there: erf t is 2 t / sqrt(pi)."""
        return 2 / sqrt(pi * self.theory.slowing) * pressure / self.spread(pressure)

    def closed_form_area(
        self, applied: float, voltage: float, critical: float, reference: float
    ) -> float:
        """A/A0 in proportion to ``p0 / (1 - (V/Vc)^2)``, by that of a reference pressure."""
        pressure = applied / (1 - (voltage / critical) ** 2)
        return min(1.0, self.light_area(reference) * pressure / reference)


def softened(modulus_pa: float, left: float, seconds: float, constant_s: float) -> float:
    """Modulus that relaxes at the rate (E - left E0)/constant, by small steps."""
    steps = 20_000
    ratio = 1.0
    for _ in range(steps):
        ratio += (left - ratio) * seconds / steps / constant_s
    return modulus_pa * ratio


def shear_at_speed(stress_pa: float, speed: float, exponent: float) -> float:
    """tau_f at a speed [mm/s]: a straight line in a log-log plot through its own at 30 mm/s."""
    return float(np.exp(np.log(stress_pa) + exponent * (np.log(speed) - np.log(30.0))))


def sheared_area(at_rest_m2: float, loss: float) -> float:
    """A0 of a finger that slides."""
    return at_rest_m2 - loss * at_rest_m2


TERMS = {
    "layered-skin": Solid.effective,
    "apparent-area": apparent_area,
    "finite-size": SelfAffine.highest_asperity,
    "plasticity": two_walls,
    "skin-dielectric": thickness,
    "leaky-gap": thickness,
    "field-limit": held_square,
    "body-return": voltage_left,
    "occlusion": softened,
    "sliding-speed": shear_at_speed,
    "shear-area": sheared_area,
    "breakdown": breaks_down,
}
"""Independent implementation of each term of the package."""
