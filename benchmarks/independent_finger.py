"""Fingers on driven screens by a solver that the package never sees, for calibrations.

The contact is that of ``oracle.py`` (the mean field's equations, by other means) or of boundary
elements solved here; friction, drive, response and the person's hand are written anew. It imports
numpy, scipy and the oracle alone, nothing of haptix or its calibration. A truth's contact follows
from one table by exact scaling: all moduli times e and all heights times s scale pressures by e s
and gaps by s.

    python benchmarks/independent_finger.py contacts.npz     # the mean field's forms, 10 minutes
    python benchmarks/independent_finger.py contacts.npz --elements

``--elements`` adds surfaces of boundary elements, which docs/calibration.md has figures of. Today
its solver does not converge at the highest pressure: it ends there, and the forms stay in the file.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import pi
from pathlib import Path

import numpy as np
import numpy.typing as npt
from oracle import CORRECTED, EPS0, PUBLISHED, Oracle, SelfAffine, Solid, thickness
from oracle import Theory as MeanField
from scipy.interpolate import CubicSpline

Array = npt.NDArray[np.float64]

MODULUS, BULK, POISSON, LAYER = 40e6, 1e4, 0.5, 2e-4
H_RMS, HURST, Q0, ROLLOFF, Q1 = 22e-6, 0.86, 1000.0, 3992.9, 1e9
SKIN = (
    (10.0, 100.0, 1e3, 1e4, 1e5, 1e6),
    (1e4, 3000.0, 1500.0, 1000.0, 600.0, 300.0),
    (1e5, 1e5, 3e4, 8e3, 2e3, 300.0),
)
"""Frequency [Hz], permittivity and resistivity [Ohm m] of the stratum corneum."""
PLAIN = MeanField(**{**vars(CORRECTED), "combined": False})
THEORIES: Mapping[str, MeanField] = {"own": CORRECTED, "plain": PLAIN, "open-gaps": PUBLISHED}
PRESSURES = np.geomspace(2e2, 1e6, 56)
GAPS = np.geomspace(1e-9, 4e-4, 340)
AREAS = np.geomspace(1.5e-5, 1.2e-4, 7)
_FINE = np.linspace(np.log(PRESSURES[0]), np.log(PRESSURES[-1]), 1000)

# Boundary elements: one cell of 6.3 mm is one fingertip. Waves shorter than 8 points are left out.
_POINTS, _SURFACES, _FINEST_WAVE = 512, 2, 8
CUT_OFF = Q0 * _POINTS / _FINEST_WAVE
"""Largest wavenumber [1/m] of the surfaces of boundary elements."""
_TOLERANCE, _MOST_STEPS = 1e-3, 2000  # of h_rms


@dataclass(frozen=True)
class Contact:
    """Area and gaps of one finger against pressure, at `MODULUS` and `H_RMS`.

    `area` has A/A0 at `PRESSURES`; row i of `gaps` the shares of the surface with gaps near `GAPS`;
    `touching` the pressure [Pa] at which the mean gap is the highest peak's, at `AREAS` (0: none).
    """

    area: Array
    gaps: Array
    touching: Array

    @classmethod
    def mean_field(cls, theory: MeanField) -> Contact:
        """Tabulate the oracle's mean field."""
        rough = SelfAffine(H_RMS, HURST, Q0, ROLLOFF, Q1)
        oracle = Oracle(rough, Solid(MODULUS, POISSON, LAYER, BULK), theory)
        rows = []
        edges = np.sqrt(GAPS[1:] * GAPS[:-1])
        for pressure in PRESSURES.tolist():
            u, density, closed = oracle.gaps(pressure, GAPS[0] / 10)
            cells = np.diff(np.log(u)) * (density[1:] * u[1:] + density[:-1] * u[:-1]) / 2
            below = np.concatenate([[closed], closed + np.cumsum(cells)])
            at = np.interp(np.log(edges), np.log(u), below)
            rows.append(np.diff(np.concatenate([[0.0], at, [below[-1]]])))
        peaks = [oracle.height(rough, area) for area in AREAS.tolist()] if theory.smooth else []
        touching = [oracle.touching_pressure(peak) for peak in peaks] or np.zeros(len(AREAS))
        area = [oracle.area_fraction(p) for p in PRESSURES.tolist()]
        return cls(np.array(area), np.array(rows), np.array(touching))

    @classmethod
    def boundary_elements(cls, points: int = _POINTS, surfaces: int = _SURFACES) -> Contact:
        """Solve random surfaces by boundary elements, at pressures that fingers have."""
        wave = Q0 * np.hypot(*np.meshgrid(*[np.fft.fftfreq(points, 1 / points)] * 2))
        wave[0, 0] = Q0
        solid = Solid(MODULUS, POISSON, LAYER, BULK)
        known = np.geomspace(Q0, wave.max() * 1.001, 200)
        modulus = np.exp(np.interp(np.log(wave), np.log(known), np.log(solid.effective(known))))
        compliance = 2 / (modulus * wave)
        compliance[0, 0] = 0.0
        shortest = Q0 * points / _FINEST_WAVE
        power = np.maximum(wave / ROLLOFF, 1.0) ** (-2 - 2 * HURST) * (wave <= shortest)
        power[0, 0] = 0.0
        edges = np.concatenate([[0.0], np.sqrt(GAPS[1:] * GAPS[:-1]), [np.inf]])
        some = PRESSURES[(PRESSURES > 400) & (PRESSURES < 3e5)][::3]
        area, gaps = np.zeros((surfaces, len(some))), np.zeros((surfaces, len(some), len(GAPS)))
        for number in range(surfaces):
            white = np.fft.fft2(np.random.default_rng(number).normal(size=(points, points)))
            height = np.fft.ifft2(white * np.sqrt(power)).real
            height *= H_RMS / height.std()
            pressure = np.full((points, points), some[-1])
            for row, wanted in reversed(list(enumerate(some.tolist()))):
                pressure, gap = _pressed(height, compliance, wanted, pressure)
                touches = pressure > 0
                area[number, row] = touches.mean()
                shares, _ = np.histogram(gap[~touches], edges)
                gaps[number, row] = shares / gap.size
                print(number, f"{wanted:.3g} Pa, area {touches.mean():.3g}", flush=True)
        log_p, log_some = np.log(PRESSURES), np.log(some)
        # Beyond, area goes on in proportion to the pressure.
        mean = gaps.mean(0)
        law = CubicSpline(log_some, np.log(area.mean(0)) - log_some)
        smooth = np.exp(log_p + law(np.clip(log_p, log_some[0], log_some[-1])))
        rows = np.stack([np.interp(log_p, log_some, column) for column in mean.T], axis=-1)
        return cls(np.minimum(smooth, 1.0), rows, np.zeros(len(AREAS)))


def _pressed(height: Array, compliance: Array, wanted: float, start: Array) -> tuple[Array, Array]:
    """Pressures [Pa] and gaps [m] of a rough rigid surface pressed into a flat elastic one.

    Conjugate gradients with the load held (Polonsky and Keer, Wear 231, 206, 1999).
    """

    def bent(pressure: Array) -> Array:
        return np.fft.irfft2(np.fft.rfft2(pressure) * half, height.shape)

    half = compliance[:, : height.shape[1] // 2 + 1]
    pressure = start * wanted / start.mean()
    along, last, conjugate = np.zeros_like(height), 1.0, 0.0
    gap = height
    for _ in range(_MOST_STEPS):
        gap = bent(pressure) - height
        touches = pressure > 0
        gap = gap - gap[touches].mean()
        # Where it touches no gap, elsewhere no overlap.
        if max(np.abs(gap[touches]).max(), -gap.min()) < _TOLERANCE * H_RMS:
            return pressure, np.maximum(gap, 0.0)
        size = float((gap[touches] ** 2).sum())
        along = np.where(touches, gap + conjugate * size / last * along, 0.0)
        last = size
        moved = bent(along)
        moved = moved - moved[touches].mean()
        step = float((gap * along)[touches].sum() / (moved * along)[touches].sum())
        new = np.maximum(np.where(touches, pressure - step * along, 0.0), 0.0)
        again = (new == 0) & (gap < 0)
        new[again] -= step * gap[again]
        conjugate = 0.0 if again.any() else 1.0
        pressure = new * wanted / new.mean()
    raise SystemExit(f"{wanted:g} Pa: no solution within {_MOST_STEPS} steps")


def contacts(path: Path) -> dict[str, Contact]:
    """All contacts, read from a file that this module's program makes."""
    with np.load(path) as file:
        names = {key.partition("/")[0] for key in file}
        keys = ("area", "gaps", "touching")
        return {name: Contact(*(file[f"{name}/{key}"] for key in keys)) for name in names}


@dataclass(frozen=True)
class Felt:
    """What a finger does and feels, at the samples of a recording; friction is positive."""

    t_s: Array
    x_mm: Array
    normal_force_n: Array
    friction_force_n: Array
    drive_v: Array


@dataclass(frozen=True)
class Finger:
    """A finger on a screen: numbers by the names that a calibration gives them."""

    contact: Contact
    values: Mapping[str, float]
    repeatability: float = 0.01
    rate_hz: float = 10_000.0
    amplifier: float = 1.0
    _tables: dict[float, tuple[Array, Array]] = field(default_factory=dict, repr=False)

    def mu(self, force: Array, voltage: float, hertz: float, speed: float, phase: Array) -> Array:
        """Friction coefficient at forces [N] and phases of the drive, in equilibrium."""
        known = self.values
        scale = known["youngs_modulus_pa"] / MODULUS * known["h_rms_m"] / H_RMS
        area0 = known["apparent_area_at_1n_m2"] * force ** known["apparent_area_exponent"]
        applied = force / area0
        steady, turning = self._attraction(hertz)
        # The response follows the square of the field, at twice the frequency.
        slow = 1 / (1 + 2j * hertz / (known["response_hz_per_mm_per_s"] * speed))
        strength = EPS0 * voltage**2 / 4
        turn = slow * np.exp(2j * phase)
        table = _FINE
        touching = scale * np.exp(
            np.interp(np.log(area0), np.log(AREAS), np.log(self.contact.touching + 1e-12))
        )
        pressure = applied
        for _ in range(60):
            near = np.sqrt(pressure * (pressure ** (2 / 3) + touching ** (2 / 3)) ** 1.5)
            at = np.log(near / scale)
            one = np.exp(np.interp(at, table, np.log(steady)))
            two = np.interp(at, table, turning.real) + 1j * np.interp(at, table, turning.imag)
            pull = strength * (one + (two * one * turn).real)
            new = applied + np.maximum(pull, 0.0)
            if float(np.max(np.abs(new / pressure - 1))) < 1e-9:
                break
            pressure = new
        log_area = CubicSpline(np.log(PRESSURES), np.log(self.contact.area))(_FINE)
        area = np.exp(np.interp(np.log(pressure / scale), table, log_area))
        return np.asarray(known["frictional_shear_stress_pa"] * area * area0 / force)

    def _attraction(self, hertz: float) -> tuple[Array, Array]:
        """Mean square field at `PRESSURES`, and its part that turns at 2f over it, complex."""
        if hertz not in self._tables:
            h0, skin = self.values["h0_m"], LAYER * self.values["skin_dielectric_scale"]
            thick = thickness(h0, hertz, skin, SKIN)
            inverse = 1 / (GAPS * self.values["h_rms_m"] / H_RMS + thick)
            steady = self.contact.gaps @ np.abs(inverse) ** 2
            turning = (self.contact.gaps @ inverse**2) / steady
            log_p = np.log(PRESSURES)
            fine = CubicSpline(log_p, np.log(steady))(_FINE), CubicSpline(log_p, turning)(_FINE)
            self._tables[hertz] = np.exp(fine[0]), fine[1]
        return self._tables[hertz]

    def is_light(self, force: float, voltage: float, hertz: float) -> bool:
        """Whether friction stays below four times that at rest at all phases: no pull-in."""
        forces, phase = np.full(16, force), pi * np.arange(16) / 16
        with np.errstate(all="ignore"):
            found = self.mu(forces, voltage, hertz, 50.0, phase).max()
        return bool(found < 4 * self.mean_mu(force, 0.0, hertz))

    def mean_mu(self, force: float, voltage: float, hertz: float, speed: float = 50.0) -> float:
        """Mean friction coefficient over a period of the drive."""
        phase = pi * np.arange(64) / 64
        return float(self.mu(np.full(64, force), voltage, hertz, speed, phase).mean())

    def slide(
        self,
        rng: np.random.Generator,
        force_n: float,
        voltage_v: float,
        hertz: float,
        speed_mm_per_s: float = 50.0,
        length_mm: float = 40.0,
        idle_s: float = 0.3,
    ) -> Felt:
        """Slide there and back, by a hand that is some 5 % off and trembles."""
        speed = speed_mm_per_s * (1 + 0.04 * rng.normal())
        wanted = force_n * (1 + 0.04 * rng.normal())
        way = length_mm / speed
        lasts = 2 * idle_s + 2 * way + 1.2
        t = np.arange(int(lasts * self.rate_hz)) / self.rate_hz
        press = (lasts - 2 * way - 0.2) / 2 - 0.1
        begin = press + 0.15, press + 0.3 + way
        velocity = sum(
            sign * np.interp(t, [at, at + 0.03, at + way, at + way + 0.03], [0, speed, speed, 0])
            for sign, at in zip((1, -1), begin, strict=True)
        )
        lift = begin[1] + way + 0.12
        shape = np.interp(t, [press - 0.06, press, lift, lift + 0.06], [0.0, 1.0, 1.0, 0.0])
        tremor = sum(
            0.015 * np.sin(2 * pi * rng.uniform(3, 12) * t + rng.uniform(0, 2 * pi))
            for _ in range(4)
        )
        force = np.maximum(wanted * shape * (1 + tremor), 0.0)
        fade = np.interp(t, [0, 0.02, t[-1] - 0.02, t[-1]], [0.0, 1.0, 1.0, 0.0])
        phase = 2 * pi * hertz * t
        slides = np.abs(velocity) > 1.0
        mu = np.zeros_like(t)
        if voltage_v == 0 or hertz > 0.2 * self.rate_hz:  # the recorder's filter takes 2f away
            knots = np.geomspace(force[slides].min(), force[slides].max(), 12)
            at = [self.mean_mu(one, self.amplifier * voltage_v, hertz, speed) for one in knots]
            mu[slides] = np.interp(force[slides], knots, at)
        else:
            volts = self.amplifier * voltage_v
            mu[slides] = self.mu(force[slides], volts, hertz, speed, phase[slides] - pi / 2)
        dry = 1 + self.repeatability * rng.normal()
        x = np.concatenate([[0.0], np.cumsum(velocity[1:] + velocity[:-1]) / 2 / self.rate_hz])
        return Felt(t, x, force, mu * force * dry, voltage_v * fade * np.sin(phase))


def main() -> None:
    solved = {name: Contact.mean_field(theory) for name, theory in THEORIES.items()}
    _save(Path(sys.argv[1]), solved)
    if "--elements" in sys.argv[2:]:
        _save(Path(sys.argv[1]), {**solved, "boundary elements": Contact.boundary_elements()})


def _save(path: Path, solved: Mapping[str, Contact]) -> None:
    arrays = {f"{name}/{key}": one for name, c in solved.items() for key, one in vars(c).items()}
    np.savez_compressed(path, **arrays)


if __name__ == "__main__":
    main()
