"""Coverage of calibrations: random truths, misspecified ones included, on good and bad rigs.

    python benchmarks/calibrations.py trials.csv [--truths 200] [--seed 0] [--broken]
    python benchmarks/calibrations.py trials.csv --summary

One row for each truth, written when it is done: the same command again continues. Every second
truth is of the fit's own form, every fourth of the other gap distribution and of the other theory.
Fingers are drawn from the priors of the fits, their skin with 0.5 to 2 times the assumed dielectric
and a response of 5 to 30 Hz per mm/s; screens of 70 to 300 nm. A rig of ``rigs.py`` reads the
strokes of a short protocol; with ``--broken`` one that no strokes can tell from a good one, or
should. Verified as without a rig check, and once more with one that measured the true gains.
"""

from __future__ import annotations

import argparse
import csv
import time
import warnings
from pathlib import Path

import numpy as np
import torch
from rigs import BROKEN, RIGS, feel, read
from scipy.stats import binomtest

import haptix
from calibration import (
    Parameters,
    StrokePredictor,
    fit_strokes,
    reduce_session,
    short_protocol,
    verify,
)
from calibration.forms import other_forms
from calibration.practice import draw_parameters
from calibration.predict import StrokeConditions
from calibration.profile import finger_at
from calibration.rig import RigCheck
from haptix.perception import WEBER_FRACTION

VOLTAGES_V = (200.0, 170.0, 140.0, 120.0, 100.0, 80.0, 60.0, 45.0)
FORMS = ("own", "plain", "own", "open-gaps")
AMPLIFIER = {"amplifier x 0.9": 0.9}


class Bench:
    """Everything that all truths share."""

    def __init__(self) -> None:
        self.finger = haptix.Finger.preset("semi-wet")
        self.screen = haptix.Screen.preset("3m-sct3250").replace(name="panel")
        model = haptix.ContactModel(self.finger, self.screen)
        self.predictor = StrokePredictor(model)
        self.forms = other_forms(model)
        self.start = Parameters.of(self.finger, self.screen).with_rig()

    def truth(self, number: int, seed: int) -> tuple[haptix.ContactModel, dict[str, float]]:
        """Draw a finger and a screen; the values are those of the truth's own form."""
        rng = np.random.default_rng([seed, number])
        drawn = draw_parameters(Parameters.of(self.finger, self.screen), rng)
        values = {one.name: one.value for one in drawn.all}
        values["skin_dielectric_scale"] = float(np.exp(rng.uniform(*np.log([0.5, 2.0]))))
        values["response_hz_per_mm_per_s"] = float(np.exp(rng.uniform(*np.log([5.0, 30.0]))))
        thickness = values["h0_m"] * self.screen.insulator_permittivity
        screen = self.screen.replace(insulator_thickness_m=thickness)
        finger = finger_at(self.finger, values)
        form = FORMS[number % len(FORMS)]
        if form == "plain":
            model = haptix.ContactModel(finger, screen, gap_distribution="plain")
        elif form == "open-gaps":
            model = haptix.ContactModel(finger, screen, theory="open-gaps")
        else:
            model = haptix.ContactModel(finger, screen)
        values["frictional_shear_stress_pa"] = float(model.finger.frictional_shear_stress_pa)
        return model, values

    def trial(self, number: int, seed: int, broken: bool) -> dict[str, object]:
        """Measure, fit and verify one truth."""
        model, values = self.truth(number, seed)
        own = Parameters.of(model.finger, model.screen)
        true = StrokePredictor(model)

        def friction(predictor: StrokePredictor, known: Parameters, places: StrokeConditions):
            return predictor(places, known.names, known.log_values, jacobian=False)

        # The highest voltage without pull-in, as a technician finds it by trying.
        volts = next(
            (v for v in VOLTAGES_V if friction(true, own, _edge(v)).is_light.all()), VOLTAGES_V[-1]
        )
        rigs = [*BROKEN, *AMPLIFIER] if broken else list(RIGS)
        name = rigs[number % len(rigs)]
        rig = (BROKEN if broken else RIGS).get(name, RIGS["realistic"])
        amplifier = AMPLIFIER.get(name, 1.0)
        plan = short_protocol(self.predictor, self.start, 3.0, volts)
        began = time.process_time()
        felt = feel(model, plan, number, amplifier=amplifier)
        reduced = reduce_session(read(felt, rig, number), plan.idle_s)
        played = time.process_time()
        fit = fit_strokes(reduced, self.predictor, self.start, forms=self.forms)
        fitted = time.process_time()
        finger = finger_at(self.finger, {n: fit.best(n) for n in values if n != "h0_m"})
        thickness = fit.best("h0_m") * self.screen.insulator_permittivity
        screen = self.screen.replace(insulator_thickness_m=thickness)
        written = StrokePredictor(haptix.ContactModel(finger, screen))
        checked = RigCheck(
            normal_gain=rig.normal_gain,
            tangential_gain=rig.tangential_gain,
            voltage_gain=amplifier,
        )
        verdicts = [verify(fit, reduced, written, rig=one) for one in (None, checked)]
        axes = np.meshgrid([0.2, 0.5, 0.8], volts * np.linspace(0, 0.9, 4), [125.0, 4000.0], [50.0])
        places = StrokeConditions(*(axis.ravel() for axis in axes))
        known = Parameters.of(finger, screen)
        right, found = friction(true, own, places), friction(written, known, places)
        off = np.abs(np.expm1(found.log_mu - right.log_mu))[right.is_light & found.is_light]
        off /= WEBER_FRACTION
        row: dict[str, object] = {
            "truth": number,
            "form": FORMS[number % len(FORMS)],
            "rig": name,
            "volts": volts,
            "friction_error_median_jnd": f"{np.median(off):.4f}",
            "friction_error_worst_jnd": f"{off.max():.4f}",
            "verdict": verdicts[0].verdict,
            "verdict_with_rig_check": verdicts[1].verdict,
            "bound_jnd": f"{verdicts[0].bound_thresholds:.3f}",
            "outliers": len(reduced.outliers),
            "fit_s": f"{fitted - played:.1f}",
            "play_s": f"{played - began:.1f}",
            "failures": "; ".join(verdicts[1].failures)[:200],
        }
        for one in fit.estimates:
            if one.name in values:
                row[f"{one.name} holds"] = int(one.low <= values[one.name] <= one.high)
                row[f"{one.name} spread"] = f"{one.spread:.4f}"
                row[f"{one.name} error"] = f"{np.log(fit.best(one.name) / values[one.name]):.4f}"
        return row


def _edge(volts: float) -> StrokeConditions:
    hertz = np.array([30.0, 125.0, 4000.0])
    return StrokeConditions(np.full(3, 0.08), np.full(3, 1.05 * volts), hertz, np.full(3, 50.0))


def summary(path: Path) -> None:
    """Print coverage with its binomial test, widths, and verdicts."""
    with path.open() as file:
        rows = list(csv.DictReader(file))
    print(f"{len(rows)} truths; 90 % intervals")
    names = [key.removesuffix(" holds") for key in rows[0] if key.endswith(" holds")]
    for name in names:
        held = sum(int(row[f"{name} holds"]) for row in rows)
        p = binomtest(held, len(rows), 0.9).pvalue
        spread = np.median([float(row[f"{name} spread"]) for row in rows])
        error = np.median([abs(float(row[f"{name} error"])) for row in rows])
        print(
            f"  {name:32} holds {held:3} of {len(rows)} (p {p:.3f}), spread {spread:.1%}, "
            f"error {error:.1%} (medians)"
        )
    for key in ("form", "rig"):
        for value in dict.fromkeys(row[key] for row in rows):
            some = [row for row in rows if row[key] == value]
            worst = [float(row["friction_error_worst_jnd"]) for row in some]
            good = [row["verdict"] != "failed" for row in some]
            checked = [row["verdict_with_rig_check"] == "passed" for row in some]
            wrong = sum(one and far > 0.5 for one, far in zip(checked, worst, strict=True))
            print(
                f"{key} {value:18} {len(some):3} truths: provisional {sum(good)}, passed with a "
                f"rig check {sum(checked)}, of these wrong by half a JND or more {wrong}; friction "
                f"error, worst place: median {np.median(worst):.2f}, largest {max(worst):.2f} JND"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--truths", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--broken", action="store_true")
    parser.add_argument("--summary", action="store_true")
    asked = parser.parse_args()
    if asked.summary:
        summary(asked.out)
        return
    torch.set_num_threads(1)
    warnings.simplefilter("ignore")
    done = len(asked.out.read_text().splitlines()) - 1 if asked.out.exists() else 0
    bench = Bench()
    for number in range(max(done, 0), asked.truths):
        row = bench.trial(number, asked.seed, asked.broken)
        with asked.out.open("a", newline="") as file:
            writer = csv.DictWriter(file, list(row))
            if number == 0:
                writer.writeheader()
            writer.writerow(row)
        print(*list(row.values())[:10], flush=True)
    summary(asked.out)


if __name__ == "__main__":
    main()
