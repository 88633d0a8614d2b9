"""Unseen fingers, known by their current: how near mu(V)/mu(0) comes, against open loop.

The truth is ``independent_finger.py``: other contact laws and other distributions of the gaps, by
tables that it makes. The current through panel, contact and body is worked out here, of its gaps.
Nothing of the package stands in the truth; `haptix.play.sensing` sees readings and touches alone.

    python benchmarks/independent_finger.py contacts.npz     # once
    python benchmarks/sensing.py contacts.npz                # 100 fingers of each contact
    python benchmarks/sensing.py contacts.npz --noise 0.01
    python benchmarks/sensing.py contacts.npz --spread 2     # fingers beyond the population
    python benchmarks/sensing.py contacts.npz --spread 0.2   # fingers like the surface's own
    python benchmarks/sensing.py contacts.npz --drift 0.01   # a gain that changes by 1 % a second
    python benchmarks/sensing.py contacts.npz --per-v 3e-4   # and by 3 % in 100 V
    python benchmarks/sensing.py contacts.npz --press 2      # a force that grows twofold
    python benchmarks/sensing.py contacts.npz --changed      # a screen that has changed since
    python benchmarks/sensing.py hostile 200000              # streams of readings that lie
"""

from __future__ import annotations

import argparse
import logging
import os
import sys
from dataclasses import dataclass, replace
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from independent_finger import (
    AREAS,
    EPS0,
    GAPS,
    H_RMS,
    LAYER,
    MODULUS,
    PRESSURES,
    SKIN,
    Contact,
    Finger,
    contacts,
)
from oracle import thickness

import haptix
from firmware_io import CurrentReading
from haptix.model.surface import Slice
from haptix.play.render.adapting import Adaptation
from haptix.play.sensing import (
    ContactCurrent,
    EnrolledFinger,
    FingerObserver,
    Knowledge,
    contact_change,
)
from haptix.play.sensing.finger_observer import SensorWatch

Array = npt.NDArray[np.float64]

HERTZ, PANEL_F, BODY_F = 4000.0, 2e-9, 150e-12
RATE_HZ, DELAY_S, FULL_A = 250.0, 0.002, 0.02
JND = 0.11
NOMINAL = {
    "youngs_modulus_pa": MODULUS,
    "h_rms_m": H_RMS,
    "apparent_area_at_1n_m2": 45.65e-6,
    "apparent_area_exponent": 0.1366,
    "frictional_shear_stress_pa": 8e6,
    "h0_m": 0.125e-6,
    "skin_dielectric_scale": 1.0,
    "response_hz_per_mm_per_s": 13.8,
}
SPREAD = {
    "youngs_modulus_pa": 0.5,
    "h_rms_m": 0.25,
    "apparent_area_at_1n_m2": 0.3,
    "frictional_shear_stress_pa": 0.3,
}
"""Standard deviations of the logarithms (physics page, section 12)."""


def told_of(
    t_s: float, current_a: complex, volts: float, is_saturated: bool = False
) -> CurrentReading:
    return CurrentReading(t_s, current_a.real, current_a.imag, volts, is_saturated)


@dataclass(frozen=True)
class Erring:
    """What a converter and a hand do that the observer does not expect."""

    drift_per_s: float = 0.0
    """Relative change of the converter's gain."""
    per_v: float = 0.0
    press: float = 1.0
    """Force at the end of a stroke over that at its beginning."""

    def gain(self, t_s: float, volts: float) -> float:
        return 1 + self.drift_per_s * t_s + self.per_v * volts


@dataclass(frozen=True)
class Truth:
    """A finger of the independent simulator, with what it draws."""

    finger: Finger

    def ratio(self, force_n: float, volts: float) -> float:
        return self.finger.mean_mu(force_n, volts, HERTZ) / self.finger.mean_mu(force_n, 0.0, HERTZ)

    def farads(self, force_n: float, volts: float) -> complex:
        """Contact and body in series."""
        known = self.finger.values
        scale = known["youngs_modulus_pa"] / MODULUS * known["h_rms_m"] / H_RMS
        area0 = known["apparent_area_at_1n_m2"] * force_n ** known["apparent_area_exponent"]
        mu = self.finger.mean_mu(force_n, volts, HERTZ)
        area = mu * force_n / known["frictional_shear_stress_pa"] / area0
        log_p = np.log(PRESSURES)
        # The area says the pressure: both rise together.
        p = np.interp(np.log(area), np.log(self.finger.contact.area), log_p)
        skin = LAYER * known["skin_dielectric_scale"]
        thick = thickness(known["h0_m"], HERTZ, skin, SKIN)
        touching = scale * np.exp(
            np.interp(np.log(area0), np.log(AREAS), np.log(self.finger.contact.touching + 1e-12))
        )
        pressure = scale * np.exp(p)
        near = np.sqrt(pressure * (pressure ** (2 / 3) + touching ** (2 / 3)) ** 1.5)
        each = self.finger.contact.gaps @ (1 / (GAPS * known["h_rms_m"] / H_RMS + thick))
        at = np.log(near / scale)
        gaps = np.interp(at, log_p, each.real) + 1j * np.interp(at, log_p, each.imag)
        contact = EPS0 * area0 * (gaps + area / thick)
        # The sign of i: an insulator that leaks draws current in phase with the voltage.
        contact = complex(contact.real, -abs(contact.imag))
        return contact * BODY_F / (contact + BODY_F)


def drawn(
    contact: Contact, random: np.random.Generator, spread: dict[str, float]
) -> tuple[Truth, float, float]:
    """A finger, its force and the highest voltage of what it strokes."""
    while True:
        values = dict(NOMINAL)
        for name, width in spread.items():
            values[name] *= float(np.exp(width * random.normal()))
        force, volts = float(random.uniform(0.15, 0.8)), float(random.uniform(40, 150))
        finger = Finger(contact, values)
        if finger.is_light(force, volts, HERTZ):
            return Truth(finger), force, volts


def drifting(truth: Truth, share: float) -> Truth:
    """The same finger with more or less sweat: its skin insulates by that much less."""
    values = dict(truth.finger.values)
    values["skin_dielectric_scale"] *= 1 - share
    return Truth(replace(truth.finger, values=values, _tables={}))


def stroke(
    truth: Truth,
    force_n: float,
    volts: float,
    model: ContactCurrent,
    noise: float,
    slid_s: float,
    random: np.random.Generator,
    person: EnrolledFinger | None = None,
    weighed_n: float | None = None,
    erring: Erring = Erring(),
) -> tuple[FingerObserver, float]:
    """Let an observer see an untouched panel for 2 s, then a stroke; return it and the time."""
    observer = FingerObserver(model, person=person)
    jw, step = 2j * pi * HERTZ, 1 / RATE_HZ
    each = noise * np.sqrt(0.010 * RATE_HZ)

    def told(at_s: float, farads: complex, amplitude: float) -> None:
        current = jw * farads * amplitude * erring.gain(at_s, amplitude)
        error = random.normal(size=2) @ (1, 1j) * each * abs(current)
        error += random.normal(size=2) @ (1, 1j) * 1e-5 * FULL_A  # 12 bits after the lock-in
        reading = told_of(at_s, complex(current + error), amplitude)
        observer.read(reading, at_s + DELAY_S)

    for i in range(int(2 * RATE_HZ)):
        told(i * step, PANEL_F, 20.0)
    # At this voltage and two others; in between the capacitance is a parabola of V^2.
    knots = np.array([0.5, 0.8, 1.0]) * volts
    rows = []
    for share in (0.0, 0.1 / 60 * slid_s):
        one = drifting(truth, share)
        rows.append(np.polyfit(knots**2, [one.farads(force_n, v) for v in knots.tolist()], 2))
    begin = 2.0 + step
    tremor = random.uniform(0, 2 * pi)
    slope = np.log(abs(truth.farads(1.05 * force_n, volts) / truth.farads(force_n, volts)))
    slope /= np.log(1.05)
    for i in range(int(slid_s * RATE_HZ) + 1):
        at = begin + i * step
        if i % 3 == 0:
            speed = 50.0 * min(1.0, (at - begin) / 0.02)
            observer.touched(at, 1, speed, weighed_n)
        amplitude = volts * (0.75 + 0.25 * np.sin(2 * pi * 20 * at))
        part = i * step / slid_s
        pressed = (1 + 0.03 * np.sin(2 * pi * 6 * at + tremor)) * erring.press**part
        farads = sum(
            w * np.polyval(row, amplitude**2) for w, row in zip((1 - part, part), rows, strict=True)
        )
        told(at, PANEL_F + farads * pressed**slope, float(amplitude))
    return observer, at + DELAY_S


def fingers(
    contact: Contact,
    model: ContactCurrent,
    count: int,
    noise: float,
    slid_s: float,
    seed: int,
    skin: float,
    is_enrolled: bool = False,
    wider: float = 1.0,
    erring: Erring = Erring(),
) -> dict[str, Array]:
    """Errors [JND] of the ratio, open loop and sensed, and of ln force."""
    random = np.random.default_rng(seed)
    spread = {name: wider * sd for name, sd in SPREAD.items()} | {"skin_dielectric_scale": skin}
    usual = model.population.force_n
    found: dict[str, list[float]] = {"open": [], "sensed": [], "sd": [], "force": [], "gain": []}
    reference = Truth(Finger(contact, NOMINAL))
    log_b = float(np.log((1 - 1 / reference.ratio(usual, 100.0)) / 1e4))
    latent = np.zeros((1, 6))
    calibrated = log_b - float(model.log_attraction(latent, 100.0)[0])
    for _ in range(count):
        truth, force, volts = drawn(contact, random, spread)
        person = None
        if is_enrolled:
            learned, _ = stroke(truth, usual, volts, model, noise, 5.0, random, None, usual)
            person = learned.enrolled()
        observer, now = stroke(
            truth, force, volts, model, noise, slid_s, random, person, None, erring
        )
        force *= erring.press
        estimate = observer.estimate(now)
        assert estimate.state is Knowledge.LEARNS, estimate
        ratio = drifting(truth, 0.1 / 60 * slid_s).ratio(force, volts)
        base = float(model.log_attraction(latent, volts)[0]) + calibrated
        for name, gain in (("open", 0.0), ("sensed", estimate.log_gain)):
            pull = min(np.exp(base + gain) * volts**2, 0.9)
            found[name].append(abs(1 / (1 - pull) / ratio - 1) / JND)
        found["force"].append(float(np.log(estimate.force_n / force)))
        true_gain = np.log((1 - 1 / ratio) / volts**2) - base
        found["sd"].append((true_gain - estimate.log_gain) / estimate.log_gain_sd)
        found["gain"].append(true_gain)
    return {name: np.array(values) for name, values in found.items()}


CHANGES: dict[str, dict[str, float]] = {
    "nothing": {},
    "gaps 10 % smaller": {"h_rms_m": 1 / 1.1},
    "gaps 10 % larger": {"h_rms_m": 1.1},
    "area 10 % larger": {"apparent_area_at_1n_m2": 1.1},
    "insulator 10 % thicker": {"h0_m": 1.1},
}
_SWEAT, _HAND, _SCALE = 0.1, 0.1, 0.03  # between two visits, standard deviations of logarithms


def changed(contact: Contact, model: ContactCurrent, count: int, noise: float, seed: int) -> None:
    """Slide 5 s on two days, at forces near each other: how often a change is flagged.

    Between them sweat differs by 10 %, the hand's force by 10 %, what a scale says by 3 %.
    """
    random = np.random.default_rng(seed)
    found: dict[str, list[tuple[bool, bool, float]]] = {name: [] for name in CHANGES}

    def visit(truth: Truth, volts: float) -> EnrolledFinger:
        sweaty = drifting(truth, 1 - float(np.exp(_SWEAT * random.normal())))
        force = model.population.force_n * float(np.exp(_HAND * random.normal()))
        told = force * float(np.exp(_SCALE * random.normal()))
        observer, _ = stroke(sweaty, force, volts, model, noise, 5.0, random, None, told)
        return observer.enrolled()

    for _ in range(count):
        truth, _, volts = drawn(contact, random, SPREAD)
        before = visit(truth, volts)
        for name, factors in CHANGES.items():
            values = {key: x * factors.get(key, 1.0) for key, x in truth.finger.values.items()}
            now = Truth(replace(truth.finger, values=values, _tables={}))
            change = contact_change(before, visit(now, volts), model)
            found[name].append(
                (change.is_changed and change.is_sure, change.is_sure, change.log_ratio)
            )
    for name, rows in found.items():
        flagged, sure, ratio = np.array(rows, dtype=float).T
        print(
            f"    {name:>24}: flagged {flagged.mean():4.0%}, sure {sure.mean():4.0%}, change "
            f"{ratio.mean():+.3f} +- {ratio.std():.3f}",
            flush=True,
        )


def hostile(streams: int, seed: int) -> int:
    """Streams of 40 readings that lie, each to an adaptation that renders: count what must not be.

    That is: a drive beyond the surface's limit, what is no number, more than 0.25 JND in 10 ms.
    """
    logging.getLogger("haptix.play.sensing").setLevel(logging.ERROR)
    random = np.random.default_rng(seed)
    known = haptix.ContactModel(haptix.Finger.preset("semi-wet"), haptix.Screen())
    surface = haptix.FrictionSurface.build(
        known, {"normal_force_n": (0.15, 0.8), "frequency_hz": HERTZ}, tolerance=5e-3
    )
    plain = Slice.of(surface.table, 180.0)
    observer = FingerObserver(ContactCurrent.of_model(known, HERTZ))
    wrong, took = 0, 0
    for number in range(streams):
        adapted = Adaptation(observer)
        adapted.reset()
        observer.watch = SensorWatch(observer.settings, HERTZ)
        observer.baseline_f = complex(PANEL_F)
        at = 0.0
        # Half of the streams begin with what could be true, and so are believed.
        kinds = [0 if number % 2 else random.integers(len(_LIES)), *random.integers(0, 8, 2)]
        usual, hops = random.uniform(25, 180), number % 3 == 0
        adapted.touched(0.0, 1, 50.0, 0.4, False)
        for i in range(40):
            at += 0.004
            volts = float(usual * random.uniform(0.9, 1.1))
            if hops and random.random() < 0.1:
                volts = float(random.choice([0.0, 15.0, 1e9, -50.0]))
            extra = _LIES[kinds[min(i // 24, 2)]](random, i)
            current = 2j * pi * HERTZ * extra * volts
            late = 0.05 if hops and random.random() < 0.03 else 0.002
            told_s = at - late
            if hops and random.random() < 0.05:  # told again, or by a clock that has wrapped
                told_s = float(
                    random.choice([told_s - 0.1, told_s - _WRAP_S, told_s + _WRAP_S, np.nan])
                )
            with np.errstate(all="ignore"):
                adapted.read(told_of(told_s, current, volts, bool(random.random() < 0.05)), at)
            if i % 4 == 0:
                adapted.window(at, 1 / 12000, True)
                slices, part = adapted.over(plain, 48)
                (low, one), (_, two) = (s.reach(np.array([0.4])) for s in slices)
                felt = float(abs(np.log(one / two)[0])) / JND
                column = slices[1].column(0.4)
                is_well = bool(
                    np.isfinite(part).all()
                    and np.isfinite(one).all()
                    and column.end_v <= 180.0
                    and low[0] > 0
                    and felt < 0.25 * 0.4
                )
                wrong += not is_well
        took += observer.estimate(at).readings
        assert abs(adapted.estimate.log_gain if adapted.estimate else 0.0) < 10
    print(f"{streams} hostile streams of 40 readings, seed {seed}: {wrong} windows wrong, ", end="")
    print(f"{took} averages were believed")
    return wrong


_WRAP_S = 2**32 / 48_000
_LIES = (
    lambda random, i: PANEL_F + random.uniform(0, 60e-12),
    lambda random, i: PANEL_F + 1e-9 * random.normal() * (1 + 1j),
    lambda random, i: 0j,
    lambda random, i: -PANEL_F,
    lambda random, i: complex(np.nan if random.random() < 0.5 else np.inf, 0),
    lambda random, i: PANEL_F + 20e-12,
    lambda random, i: PANEL_F * np.exp(2j * pi * random.random()),
    lambda random, i: PANEL_F + 290e-12 * (i % 2),
)


def main() -> None:
    if sys.argv[1:2] == ["hostile"]:
        wrong = hostile(int(sys.argv[2]), int(sys.argv[3]) if len(sys.argv) > 3 else 1)
        sys.exit(wrong > 0)
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("contacts", help="tables of independent_finger.py")
    parser.add_argument("--fingers", type=int, default=100)
    parser.add_argument("--noise", type=float, nargs="+", default=[1e-3])
    parser.add_argument("--slid", type=float, nargs="+", default=[0.5])
    parser.add_argument("--skin", type=float, default=0.0, help="sd of ln of its insulation")
    parser.add_argument("--spread", type=float, default=1.0, help="of fingers, over the usual")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--enrolled", action="store_true", help="after 5 s at a known force")
    parser.add_argument("--changed", action="store_true", help="a screen that has changed")
    parser.add_argument("--uncalibrated", action="store_true")
    parser.add_argument("--drift", type=float, default=0.0, help="of the converter's gain, 1/s")
    parser.add_argument("--per-v", type=float, default=0.0, help="change of its gain, 1/V")
    parser.add_argument("--press", type=float, default=1.0, help="force at the end over the first")
    given = parser.parse_args()
    erring = Erring(given.drift, given.per_v, given.press)
    known = haptix.ContactModel(haptix.Finger.preset("semi-wet"), haptix.Screen())
    model = ContactCurrent.of_model(known, HERTZ)
    print(
        f"{'contact':>18} noise slid |  open: median 95 % | sensed: median 95 % | force 68 % "
        "within | interval holds | worse by 0.05, 0.1 JND, most"
    )
    for name, contact in contacts(Path(given.contacts)).items():
        own = model
        if not given.uncalibrated:
            reference = Truth(Finger(contact, NOMINAL)).farads(model.population.force_n, 100.0)
            plain = complex(model.capacitance_f(np.zeros((1, 6)), 100.0)[0])
            own = model.calibrated(abs(reference) / abs(plain))
        if given.changed:
            print(name)
            changed(contact, own, given.fingers, given.noise[0], given.seed)
            continue
        for noise in given.noise:
            for slid_s in given.slid:
                found = fingers(
                    contact,
                    own,
                    given.fingers,
                    noise,
                    slid_s,
                    given.seed,
                    given.skin,
                    given.enrolled,
                    given.spread,
                    erring,
                )
                numbers: list[Any] = []
                for key in ("open", "sensed"):
                    numbers += [np.median(found[key]), np.percentile(found[key], 95)]
                numbers.append(np.percentile(np.abs(found["force"]), 68))
                shown = "  ".join(f"{number:6.2f}" for number in numbers)
                shown += f"  {np.mean(np.abs(found['sd']) < 1.96):6.0%}"
                harm = found["sensed"] - found["open"]
                shown += f" | {np.mean(harm > 0.05):4.0%} {np.mean(harm > 0.1):4.0%}"
                shown += f" {harm.max():+6.2f}"
                print(f"{name:>18} {noise:5.2%} {slid_s:4g} | {shown}", flush=True)


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
