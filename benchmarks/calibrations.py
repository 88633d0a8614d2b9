"""Coverage of calibrations: random truths, misspecified ones included, on good and bad rigs.

    python benchmarks/independent_finger.py benchmarks/campaigns/contacts.npz  # once, 20 minutes
    PYTHONPATH=benchmarks haptix campaign benchmarks/campaigns/coverage.toml --out coverage
    python benchmarks/calibrations.py coverage

Fingers, screens and rigs are those of ``independent_finger.py`` and ``rigs.py``, which import
nothing of the package. Each truth is a task; the last command sums up the campaign's table. Every
second truth is of the fit's own form, every fourth of the other gap distribution and of the other
theory; with ``truths_of = "surfaces"`` all are of random surfaces that were solved
point by point, which press on few spots. Fingers are drawn from the priors of the fits, their skin
with 0.5 to 2 times the assumed dielectric and a response of 5 to 30 Hz per mm/s; screens of 70 to
300 nm. A rig reads the strokes of a short protocol; with ``broken = true`` one that no strokes can
tell from a good one, or should. Verified as without a rig check, and once more with one that
measured the true gains.
"""

from __future__ import annotations

import argparse
import csv
import time
import warnings
from collections.abc import Iterator
from functools import lru_cache
from math import exp
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
from independent_finger import CUT_OFF, Finger, contacts
from rigs import BROKEN, RIGS
from scipy.stats import binomtest

import haptix
from calibration import (
    Parameters,
    Protocol,
    StrokePredictor,
    StrokeRecording,
    reduce_session,
    short_protocol,
    verify,
)
from calibration.fit.fitting import fit_in_best_theory, other_forms
from calibration.keep.profile import finger_at
from calibration.measure.rig import RigCheck
from calibration.plan.predict import Prediction, StrokeConditions
from haptix.base.task import Context, Result, Task
from haptix.feel.signals.audio_files import file_hash
from haptix.model.perception.thresholds import WEBER_FRACTION
from haptix.tasks.campaign import Campaign, CampaignTask

VOLTAGES_V = (200.0, 170.0, 140.0, 120.0, 100.0, 80.0, 60.0, 45.0)
FORMS = ("own", "plain", "own", "open-gaps")
SOLVED = "boundary elements"
AMPLIFIER = {"amplifier x 0.9": 0.9}
SHEAR_SPREAD = 0.3


class Written:
    """A predictor of written profiles with the fit's table, which scales exactly to theirs.

    A table of their own takes five seconds and gives the same to 1e-5; `verify_folder` makes one.
    """

    by_profiles = StrokePredictor.by_profiles

    def __init__(
        self, predictor: StrokePredictor, finger: haptix.Finger, screen: haptix.Screen
    ) -> None:
        self.model = SimpleNamespace(finger=finger, screen=screen)
        self._predictor = predictor

    def __call__(self, *args: object, **options: object) -> Prediction:
        return self._predictor(*args, **options)


class Assumed:
    """The finger and the screen from which fits start, and their plans by the highest voltage."""

    def __init__(self, finger: haptix.Finger, screen: haptix.Screen) -> None:
        self.finger = finger
        model = haptix.ContactModel(finger, screen)
        self.predictor = StrokePredictor(model)
        self.forms = other_forms(model)
        self.start = Parameters.of(finger, screen).with_rig()
        self._plans: dict[float, Protocol] = {}

    def plan(self, volts: float) -> Protocol:
        """Short protocol."""
        if volts not in self._plans:
            self._plans[volts] = short_protocol(self.predictor, self.start, 3.0, volts)
        return self._plans[volts]


class Bench:
    """Everything that all truths share."""

    def __init__(self, file: Path, solved: bool = False) -> None:
        self.forms = (SOLVED,) if solved else FORMS
        self.screen = haptix.Screen.preset("3m-sct3250").replace(name="panel")
        finger = haptix.Finger.preset("semi-wet")
        self.usual = Parameters.of(finger, self.screen)
        if solved:
            # They have the waves that their points resolve: their fit knows the band.
            coarse = finger.roughness.model_copy(update={"q1_per_m": CUT_OFF})
            finger = finger.replace(roughness=coarse)
        self.assumed = Assumed(finger, self.screen)
        self.contacts = contacts(file)

    def form(self, number: int) -> str:
        """Form of a truth."""
        return self.forms[number % len(self.forms)]

    def truth(self, number: int, seed: int, amplifier: float = 1.0) -> Finger:
        """Draw a finger and a screen; the values are those of the truth's own form."""
        rng = np.random.default_rng([seed, number])
        drawn = self.usual.all
        values = {one.name: one.value * exp(rng.normal(0, one.prior or 0.0)) for one in drawn}
        values["h0_m"] = exp(rng.uniform(*np.log([70e-9, 300e-9])))
        values["skin_dielectric_scale"] = exp(rng.uniform(*np.log([0.5, 2.0])))
        values["response_hz_per_mm_per_s"] = exp(rng.uniform(*np.log([5.0, 30.0])))
        contact = self.contacts[self.form(number)]
        # Every form with the usual friction: tau_f goes as one over the area at rest.
        share = contact.area[24] / self.contacts["own"].area[24]
        values["frictional_shear_stress_pa"] *= exp(rng.normal(0, SHEAR_SPREAD)) / share
        return Finger(contact, values, amplifier=amplifier)

    def trial(self, number: int, seed: int, broken: bool) -> tuple[dict[str, Any], dict[str, Any]]:
        """Measure, fit and verify one truth; return its numbers, and its times."""
        rigs = _rigs(broken)
        name = rigs[number % len(rigs)]
        rig = (BROKEN if broken else RIGS).get(name, RIGS["realistic"])
        amplifier = AMPLIFIER.get(name, 1.0)
        known, true = self.assumed, self.truth(number, seed, amplifier)
        # The highest voltage without pull-in, as a technician finds it by trying.
        volts = next((v for v in VOLTAGES_V if _is_light(true, v)), VOLTAGES_V[-1])
        plan = known.plan(volts)
        began = time.process_time()
        rng = np.random.default_rng([seed, number, 1])
        made = []
        for at, stroke in enumerate(plan.strokes):
            felt = true.slide(rng, stroke.normal_force_n, stroke.voltage_v, stroke.frequency_hz)
            signals = rig.read(felt, int(rng.integers(2**31)), at / len(plan.strokes))
            made.append(StrokeRecording.of(stroke, signals))
        played = time.process_time()
        reduced = reduce_session(made, plan.idle_s)
        ready = time.process_time()
        fit, predictor, _ = fit_in_best_theory(reduced, known.predictor, known.start, known.forms)
        fitted = time.process_time()
        values = true.values
        finger = finger_at(known.finger, {n: fit.best(n) for n in values if n != "h0_m"})
        thickness = fit.best("h0_m") * self.screen.insulator_permittivity
        screen = self.screen.replace(insulator_thickness_m=thickness)
        written = Written(predictor, finger, screen)
        checked = RigCheck(
            normal_gain=rig.normal_gain,
            tangential_gain=rig.tangential_gain,
            voltage_gain=amplifier,
        )
        verdicts = [verify(fit, reduced, written, rig=one) for one in (None, checked)]
        axes = np.meshgrid([0.2, 0.5, 0.8], volts * np.linspace(0, 0.9, 4), [125.0, 4000.0], [50.0])
        places = StrokeConditions(*(axis.ravel() for axis in axes))
        own = Parameters.of(finger, screen)
        found = written(places, own.names, own.log_values, jacobian=False)
        right = [true.mean_mu(*one) for one in np.transpose([axis.ravel() for axis in axes])]
        off = np.abs(np.exp(found.log_mu) / right - 1)[found.is_light] / WEBER_FRACTION
        row: dict[str, Any] = {
            "volts": volts,
            "friction_error_median_jnd": float(np.median(off)),
            "friction_error_worst_jnd": float(off.max()),
            "verdict": verdicts[0].verdict,
            "verdict_with_rig_check": verdicts[1].verdict,
            "bound_jnd": verdicts[0].bound_jnd,
            "fit_bound_jnd": verdicts[0].fit_bound_jnd,
            "strokes_used": len(fit.strokes),
            "repeatability": fit.repeatability.log_mu,
            "theory": fit.theory,
            "evidence": " ".join(f"{one.evidence:.1f}" for one in fit.forms),
            "failures": "; ".join(verdicts[1].failures)[:300],
        }
        times = {
            "play_s": played - began,
            "reduce_s": ready - played,
            "fit_s": fitted - ready,
            "verify_s": time.process_time() - fitted,
        }
        for one in fit.estimates:
            if one.name in values:
                row[f"{one.name} holds"] = int(one.low <= values[one.name] <= one.high)
                row[f"{one.name} spread"] = one.spread
                row[f"{one.name} error"] = float(np.log(fit.best(one.name) / values[one.name]))
                half = np.log(one.high / one.low) / 2 if one.low > 0 else np.inf
                row[f"{one.name} half_width"] = float(half) if half < np.inf else None
        return row, times


class CalibrateTruth(Task):
    """A calibration of one truth; `contacts` is a file and `sha256` its hash."""

    contacts: str
    sha256: str
    truth: int
    seed: int
    truths_of: Literal["forms", "surfaces"]
    broken: bool

    def run(self, context: Context) -> Result:
        """Measure, fit and verify it."""
        if file_hash(Path(self.contacts)) != self.sha256:
            raise ValueError(f"{self.contacts}: has changed since the plan was read")
        bench = _bench(self.contacts, self.truths_of == "surfaces")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            row, times = bench.trial(self.truth, self.seed, self.broken)
        return Result(row, costs=times)


class Coverage(Campaign):
    """A calibration of each truth.

    Parameters
    ----------
    contacts : str
        File of `independent_finger.py`, relative to the campaign's.
    truths, seed : int
        How many, and the seed of all.
    truths_of : {"forms", "surfaces"}
        The mean field's forms in turn, or surfaces of boundary elements.
    broken : bool
        Whether rigs are broken.
    """

    maps = (("h0_m spread", "h0_m error"), ("bound_jnd", "friction_error_worst_jnd"))

    contacts: str = "contacts.npz"
    truths: int = 200
    seed: int = 0
    truths_of: Literal["forms", "surfaces"] = "forms"
    broken: bool = False

    def tasks(self) -> Iterator[CampaignTask]:
        """Yield a task for each truth."""
        file = (self.folder / self.contacts).resolve()
        digest, rigs = file_hash(file), _rigs(self.broken)
        forms = (SOLVED,) if self.truths_of == "surfaces" else FORMS
        for number in range(self.truths):
            task = CalibrateTruth(
                contacts=str(file),
                sha256=digest,
                truth=number,
                seed=self.seed,
                truths_of=self.truths_of,
                broken=self.broken,
            )
            labels = {"form": forms[number % len(forms)], "rig": rigs[number % len(rigs)]}
            yield CampaignTask(task, {"truth": number, **labels})


@lru_cache(maxsize=1)
def _bench(file: str, solved: bool) -> Bench:
    return Bench(Path(file), solved)


def _rigs(broken: bool) -> list[str]:
    return [*BROKEN, *AMPLIFIER] if broken else list(RIGS)


def _is_light(true: Finger, volts: float) -> bool:
    return all(true.is_light(0.08, 1.05 * volts, hertz) for hertz in (30.0, 125.0, 4000.0))


def summary(path: Path) -> None:
    """Print coverage with its binomial test, widths, and verdicts."""
    with path.open() as file:
        rows = [row for row in csv.DictReader(file) if row["status"] == "done"]
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
    parser.add_argument("campaign", type=Path, help="its folder")
    summary(parser.parse_args().campaign / "table.csv")


if __name__ == "__main__":
    main()
