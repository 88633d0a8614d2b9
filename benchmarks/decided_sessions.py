"""Whole sessions on strokes of an independent solver: planned, decided, and wrong by how much.

    python benchmarks/independent_finger.py benchmarks/campaigns/contacts.npz  # once, 20 minutes
    python benchmarks/decided_sessions.py benchmarks/campaigns/contacts.npz --sessions 60

Each session has a finger and a screen of its own, with the friction of ``independent_finger.py`` in
one of its three forms, and strokes that repeat within 1 to 4 %. Short protocols are planned for
that, fitted in one theory ("open-gaps", or `--theory`), verified, and extended where the verdict is
left open. Errors are those of friction inside the range that the verdict states. With ``--defects``
friction rises late in a contact or goes with the speed, or the amplifier is weak at its highest
volts. With ``--in-forms`` passed profiles are weighed in other forms, as `haptix calibrate fit`
does, and the intervals of tau_f and h0 are compared with the truth's.
"""

from __future__ import annotations

import argparse
import json
from math import exp, pi
from pathlib import Path

import numpy as np
from calibrations import SHEAR_SPREAD, Written, _is_light
from independent_finger import Finger, contacts

import haptix
from calibration import Parameters, StrokePredictor, fit_strokes, short_protocol, verify
from calibration.fit.fitting import fit_in_best_theory, other_forms
from calibration.keep.practice import VIRTUAL_RIG
from calibration.keep.profile import calibrated_screen, finger_at, match_screens
from calibration.measure.reduction import Point, Reduced
from calibration.measure.rig import VoltsRead
from calibration.plan.parameters import PER_FINGER
from calibration.plan.predict import StrokeConditions
from calibration.verify.verification_power import MOST_HELD_OUT, extended_plan, with_enough_strokes
from haptix.model.friction import in_theory
from haptix.model.perception.thresholds import WEBER_FRACTION

FORMS = ("own", "plain", "open-gaps")
VOLTAGES_V = (150.0, 100.0, 60.0)
DEFECTS = ("contact", "speed", "amplifier")
WEAK = 0.12  # of the highest volts


class Sessions:
    """What all sessions share."""

    def __init__(self, file: Path, in_forms: bool = False, theory: str = "open-gaps") -> None:
        self.contacts = contacts(file)
        self.finger = in_theory(haptix.Finger.preset("semi-wet"), theory)
        self.screen = haptix.Screen.preset("3m-sct3250").replace(name="panel")
        self.predictor = StrokePredictor(haptix.ContactModel(self.finger, self.screen))
        self.start = Parameters.of(self.finger, self.screen).with_rig()
        self.forms = other_forms(self.predictor.model) if in_forms else {}
        self.plans, self.matched_before = {}, {}

    def plan(self, volts, repeatability):
        """Short protocol with held-out strokes enough."""
        key = volts, repeatability
        if key not in self.plans:
            short = short_protocol(self.predictor, self.start, 3.0, volts)
            self.plans[key] = with_enough_strokes(
                self.predictor, self.start, short, repeatability, volts
            )[0]
        return self.plans[key]

    def truth(self, number, seed):
        """Draw a finger and a screen; the values are those of the truth's own form."""
        rng = np.random.default_rng([seed, number])
        drawn = Parameters.of(self.finger, self.screen).all
        values = {one.name: one.value * exp(rng.normal(0, one.prior or 0.0)) for one in drawn}
        values["h0_m"] = exp(rng.uniform(*np.log([70e-9, 300e-9])))
        values["skin_dielectric_scale"] = exp(rng.uniform(*np.log([0.5, 2.0])))
        values["response_hz_per_mm_per_s"] = exp(rng.uniform(*np.log([5.0, 30.0])))
        contact = self.contacts[FORMS[number % len(FORMS)]]
        # Every form with the usual friction: tau_f goes as one over the area at rest.
        share = contact.area[24] / self.contacts["open-gaps"].area[24]
        values["frictional_shear_stress_pa"] *= exp(rng.normal(0, SHEAR_SPREAD)) / share
        return Finger(contact, values)

    def strokes(self, true, strokes, rng, repeatability, highest_v, defect):
        """Reduced strokes; an amplifier that is weak shows the volts that it should have."""
        points = []
        for one in strokes:
            force = one.normal_force_n * (1 + 0.04 * rng.normal())
            speed = one.speed_mm_per_s * (1 + 0.04 * rng.normal())
            volts = one.voltage_v * (1 - weak(one.voltage_v, highest_v) * (defect == "amplifier"))
            mu, ripple = stroke_of(true, force, volts, one.frequency_hz, speed)
            mu *= (speed / 50.0) ** (0.15 * (defect == "speed"))
            mu *= 1 + repeatability * rng.normal()
            seen = one.voltage_v > 0 and one.frequency_hz < 900
            ripple_sd = float(np.hypot(1e-3, 0.01 * ripple))
            late = bool(one.contact_s)
            rise = np.log1p(0.3 * (defect == "contact")) + 0.003 * rng.normal()
            points.append(
                Point(
                    one.number, force, one.voltage_v, one.frequency_hz, speed, mu, 0.003 * mu,
                    ripple + ripple_sd * rng.normal() if seen else np.nan, ripple_sd,
                    contact_s=one.contact_s + 2.0, rise=rise if late else np.nan,
                    rise_sd=0.003 if late else np.nan, held_out=one.held_out,
                )
            )  # fmt: skip
        return tuple(points)

    def session(self, number, seed, has_defects):
        """One session to its verdict."""
        rng = np.random.default_rng([seed, number, 1])
        repeatability = (0.01, 0.02, 0.03, 0.04)[number // len(FORMS) % 4]
        defect = DEFECTS[number % len(DEFECTS)] if has_defects else ""
        true = self.truth(number, seed)
        volts = next((v for v in VOLTAGES_V if _is_light(true, v)), VOLTAGES_V[-1])
        plan = self.plan(volts, repeatability)
        points = self.strokes(true, plan.strokes, rng, repeatability, volts, defect)
        rig = rig_of(volts, defect)
        planned_s, first = plan.duration_s, None
        while True:
            reduced = rig.corrected(Reduced(points))
            fit = fit_strokes(reduced, self.predictor, self.start)
            finger = finger_at(self.finger, {name: fit.best(name) for name in PER_FINGER})
            thickness = fit.best("h0_m") * self.screen.insulator_permittivity
            screen = self.screen.replace(insulator_thickness_m=thickness)
            written = Written(self.predictor, finger, screen)
            found = verify(fit, reduced, written, rig=rig, looks=plan.looks)
            first = first or found.verdict
            if not found.is_open or plan.looks >= 3 or len(plan.held_out) >= MOST_HELD_OUT:
                break
            longer = extended_plan(self.predictor, self.start, plan, fit, found)
            if longer is None:
                break
            plan = longer
            added = [one for one in plan.strokes if one.number > len(points)]
            points += self.strokes(true, added, rng, repeatability, volts, defect)
        off = self.errors(true, written, finger, screen, found.verified, defect)
        verdict: str = found.verdict
        more: dict[str, object] = {}
        if found.passed and self.forms:
            # The profile as `haptix calibrate fit` makes it, weighed in other forms.
            fit, own, _ = fit_in_best_theory(reduced, self.predictor, self.start, self.forms)
            best = {name: fit.best(name) for name in PER_FINGER}
            finger = finger_at(self.finger, best).replace(theory=fit.theory)
            if fit["h0_m"].value is None:
                verdict = "no profile"
            else:
                screen = calibrated_screen(screen, fit, found, own)
                held = self.held(true, fit)
                more = {"theory": fit.theory, "tau_f_holds": held[0], "h0_holds": held[1]}
        elif found.passed:
            screen = calibrated_screen(screen, fit, found, self.predictor)
        self.made = true, finger, screen, volts
        return {
            "session": number, "form": FORMS[number % len(FORMS)], "repeatability": repeatability,
            "defect": defect, "volts": volts, "planned_minutes": planned_s / 60,
            "minutes": plan.duration_s / 60, "first": first, "looks": plan.looks,
            "verdict": verdict, "worst_jnd": off, "failures": list(found.failures)[:2],
            "strokes_used": len(fit.strokes), "h0_spread": fit["h0_m"].spread,
            **more,
        }  # fmt: skip

    def held(self, true, fit):
        """Whether the 90 % interval of tau_f, and 1.645 spreads of h0, hold the truth's.

        The truth's tau_f as the fit's theory has it, whose area at rest is another.
        """
        of_theory = self.contacts["open-gaps" if fit.theory == "open-gaps" else "own"]
        share = true.contact.area[24] / of_theory.area[24]
        shear, known = true.values["frictional_shear_stress_pa"], fit["frictional_shear_stress_pa"]
        off = abs(np.log(fit.best("h0_m") / true.values["h0_m"]))
        return (
            bool(known.low <= shear * share <= known.high),
            bool(off <= 1.645 * fit["h0_m"].spread),
        )

    def matched(self, number, apart, seed):
        """Compare the screens of two sessions that passed, of two fingers, with the truth.

        That is the mean of both true fingers, each on both screens.
        """
        made = []
        for one in (number, number + apart):
            if one not in self.matched_before:
                passed = self.session(one, seed, False)["verdict"] == "passed"
                self.matched_before[one] = self.made if passed else None
            if self.matched_before[one] is None:
                return []
            made.append(self.matched_before[one])
        (one, finger_a, a, volts_a), (two, finger_b, b, volts_b) = made
        a, b = (screen.replace(max_voltage_v=min(volts_a, volts_b)) for screen in (a, b))
        rows = []
        for match in match_screens(a, b, [finger_a, finger_b], (0.3, 0.6), 4000.0, 3):
            for level in match.levels:
                place = level.normal_force_n, level.voltage_a_v, 4000.0, 50.0
                log_mu = [
                    [
                        np.log(stroke_of(Finger(f.contact, {**f.values, "h0_m": h0_m}), *place)[0])
                        for h0_m in (one.values["h0_m"], two.values["h0_m"])
                    ]
                    for f in (one, two)
                ]
                true_jnd = float(np.expm1(np.diff(log_mu).mean())) / WEBER_FRACTION
                off_jnd = abs(level.difference_jnd - true_jnd)
                rows.append({
                    "pair": number, "normal_force_n": place[0], "voltage_v": place[1],
                    "screens_jnd": level.difference_jnd, "uncertainty_jnd": level.uncertainty_jnd,
                    "true_jnd": true_jnd, "held": bool(off_jnd <= level.uncertainty_jnd),
                })  # fmt: skip
        return rows

    def errors(self, true, written, finger, screen, verified, defect):
        """Highest error of friction [JND] inside the range that is stated."""
        if verified is None:
            return None
        hertz, (low_n, high_n) = np.array([125.0, 4000.0]), verified.normal_force_n
        axes = np.meshgrid(
            np.linspace(low_n, high_n, 3), [0.0, 0.5, 0.9, 1.0], hertz,
            verified.speed_mm_per_s,
        )  # fmt: skip
        force, share, hertz, speed = (axis.ravel() for axis in axes)
        volts = share * [verified.highest_v(one) for one in hertz]
        places = StrokeConditions(force, volts, hertz, speed)
        own = Parameters.of(finger, screen)
        found = written(places, own.names, own.log_values, jacobian=False)
        rows = zip(force, volts, hertz, speed, strict=True)
        right = np.array([stroke_of(true, *one)[0] for one in rows])
        right *= (speed / 50.0) ** (0.15 * (defect == "speed"))
        right *= 1 + 0.3 * (defect == "contact")
        off = np.abs(np.exp(found.log_mu) / right - 1)[found.is_light] / WEBER_FRACTION
        return float(off.max())


def rig_of(highest_v, defect):
    """A check of the rig at a quarter, 0.6 and all of the highest volts, at two frequencies."""
    read = [
        VoltsRead(
            frequency_hz=hertz, monitor_v=share * highest_v,
            gain=1 - weak(share * highest_v, highest_v) * (defect == "amplifier"),
        )
        for hertz in (125.0, 4000.0)
        for share in (0.25, 0.6, 1.0)
    ]  # fmt: skip
    return VIRTUAL_RIG.replace(volts=read)


def weak(volts, highest_v):
    """Share of the volts that an amplifier lacks: none up to half of the highest."""
    return WEAK * max(2 * volts / highest_v - 1, 0.0)


def stroke_of(true, force, volts, hertz, speed):
    """Mean friction over a period, and the share of it that turns at 2f."""
    phase = pi * np.arange(16) / 16
    mu = true.mu(np.full(16, force), volts, hertz, speed, phase)
    return float(mu.mean()), float(2 * abs((mu * np.exp(-2j * phase)).mean()) / mu.mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("contacts", type=Path)
    parser.add_argument("--sessions", type=int, default=60)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--defects", action="store_true")
    parser.add_argument("--match", action="store_true", help="compare the screens of two sessions")
    parser.add_argument(
        "--apart",
        type=int,
        default=30,
        help="of their numbers; a multiple of 3 is one contact law",
    )
    parser.add_argument("--in-forms", action="store_true", help="weigh profiles in other forms")
    parser.add_argument("--theory", default="open-gaps", help="in which fits begin")
    asked = parser.parse_args()
    bench, rows = Sessions(asked.contacts, asked.in_forms, asked.theory), []
    if asked.match:
        for number in range(asked.first, asked.first + asked.sessions):
            for row in bench.matched(number, asked.apart, asked.seed):
                rows.append(row)
                print(json.dumps(row), flush=True)
        at_volts = [row for row in rows if row["voltage_v"] > 0]
        held = sum(row["held"] for row in at_volts)
        print(f"{held} of {len(at_volts)} differences within their stated uncertainty")
        return
    for number in range(asked.first, asked.first + asked.sessions):
        rows.append(bench.session(number, asked.seed, asked.defects))
        print(json.dumps(rows[-1]), flush=True)
    passed = [one for one in rows if one["verdict"] == "passed"]
    first = sum(one["first"] == "passed" for one in rows)
    wrong = sum(one["worst_jnd"] > 0.5 for one in passed)
    worst = max((one["worst_jnd"] for one in passed), default=float("nan"))
    print(
        f"{len(rows)} sessions: {first} passed at the first look, {len(passed)} in all; wrong by "
        f"half a JND or more {wrong}, worst {worst:.2f} JND"
    )
    if asked.in_forms:
        print(f"{sum(one['verdict'] == 'no profile' for one in rows)} determine no h0")
        for form in FORMS:
            weighed = [one for one in passed if one["form"] == form]
            tau_f, h0 = (sum(one[key] for one in weighed) for key in ("tau_f_holds", "h0_holds"))
            print(f"{form}: of {len(weighed)} intervals, those of tau_f hold {tau_f}, of h0 {h0}")


if __name__ == "__main__":
    main()
