"""Calibration of 20 random fingers and screens, with known truth, on the virtual finger.

    python benchmarks/calibrations.py [--truths 20] [--processes 2] [--seed 0]

Each truth is measured by the full and by the short protocol: played by the contact model in time,
read with noise, drift and cross-talk by a finger that cannot hold force and speed, reduced, and
fitted from the same start. Fingers are drawn from the priors that the fits have, screens of 70 to
300 nm evenly in the logarithm.
"""

from __future__ import annotations

import argparse
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from math import exp

import numpy as np
import torch

import haptix
from calibration import (
    Parameters,
    Protocol,
    StrokePredictor,
    VirtualFingerSource,
    fit_strokes,
    full_protocol,
    reduce_session,
    short_protocol,
)
from calibration.measuring import drive_for
from calibration.predict import StrokeConditions
from calibration.profile import calibrated_finger
from calibration.recording import StrokeRecording

SCREENS_M = (70e-9, 300e-9)
SHEAR_SPREAD = 0.3
VOLTAGES_V = (200.0, 170.0, 140.0, 120.0, 100.0, 80.0, 60.0)


@dataclass(frozen=True)
class Trial:
    """Results of one protocol for one true finger and screen."""

    truth: int
    protocol: str
    strokes: int
    h0_nm: float
    h0_error: float
    h0_determined: bool
    mu_error: float
    covered: dict[str, bool]
    fit_s: float
    measure_s: float


def draw_truth(number: int, seed: int, start: Parameters) -> Parameters:
    rng = np.random.default_rng([seed, number])
    values = {
        name: start[name].value * exp(rng.normal(0, start[name].prior))
        for name in start.free
        if start[name].prior is not None
    }
    values["h0_m"] = exp(rng.uniform(*np.log(SCREENS_M)))
    shear = start["frictional_shear_stress_pa"].value
    values["frictional_shear_stress_pa"] = shear * exp(rng.normal(0, SHEAR_SPREAD))
    return start.started_at(**values)


def highest_voltage(predictor: StrokePredictor, truth: Parameters) -> float:
    """Highest voltage without pull-in, as a technician finds it by trying."""
    for volts in VOLTAGES_V:
        place = (np.array([value]) for value in (0.08, 1.05 * volts, 30.0, 50.0))
        found = predictor(StrokeConditions(*place), truth.names, truth.log_values, jacobian=False)
        if found.is_light.all():
            return volts
    return VOLTAGES_V[-1]


def play(protocol: Protocol, source: VirtualFingerSource) -> list[StrokeRecording]:
    made = []
    for stroke in protocol.strokes:
        source.start(stroke, drive_for(stroke, protocol, 48_000.0))
        made.append(StrokeRecording.of(stroke, source.finish()))
    return made


def run(number: int, seed: int) -> list[Trial]:
    torch.set_num_threads(1)
    finger = haptix.Finger.preset("semi-wet")
    screen = haptix.Screen.preset("3m-sct3250").replace(name="panel")
    start = Parameters.of(finger, screen)
    predictor = StrokePredictor(haptix.ContactModel(finger, screen))
    truth = draw_truth(number, seed, start)
    values = {name: truth[name].value for name in truth.names}
    volts = highest_voltage(predictor, truth)
    # The truth is a model of its own, not the predictor's scaled table.
    own = calibrated_finger(finger, _as_fit(truth))
    thickness = values["h0_m"] * screen.insulator_permittivity
    model = haptix.ContactModel(own, screen.replace(insulator_thickness_m=thickness))
    force, level, hertz = (
        a.ravel()
        for a in np.meshgrid(
            np.linspace(0.1, 0.9, 5), volts * np.linspace(0, 1, 5), [30.0, 125.0, 1000.0]
        )
    )
    places = StrokeConditions(force, level, hertz, np.full(len(force), 50.0))
    expected = predictor(places, truth.names, truth.log_values, jacobian=False)
    found = []
    for protocol in (full_protocol(volts), short_protocol(predictor, start, 3.0, volts)):
        source = VirtualFingerSource(model, seed=1000 * number + len(protocol.strokes))
        began = time.perf_counter()
        reduced = reduce_session(play(protocol, source), protocol.idle_s)
        measured = time.perf_counter()
        fit = fit_strokes(reduced, predictor, start)
        fitted = time.perf_counter()
        mu = predictor(places, fit.names, fit.log_values, jacobian=False)
        off = np.abs(np.expm1(mu.log_mu - expected.log_mu))[expected.is_light]
        found.append(
            Trial(
                number,
                protocol.name,
                len(reduced.used),
                1e9 * values["h0_m"],
                fit.best("h0_m") / values["h0_m"] - 1,
                fit["h0_m"].value is not None,
                float(np.median(off)),
                {
                    one.name: one.low <= values[one.name] <= one.high
                    for one in fit.estimates
                    if one.verdict != "fixed"
                },
                fitted - measured,
                measured - began,
            )
        )
    return found


class _as_fit:
    """The part of `Fit` that `calibrated_finger` needs."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters

    def best(self, name: str) -> float:
        return self._parameters[name].value


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--truths", type=int, default=20)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    print(
        "truth protocol strokes  d1/eps1 nm  error %  reported  mu error %  covered  fit s  play s"
    )
    trials: list[Trial] = []
    with ProcessPoolExecutor(asked.processes) as pool:
        for made in pool.map(run, range(asked.truths), [asked.seed] * asked.truths):
            trials += made
            for one in made:
                print(
                    f"{one.truth:5} {one.protocol:8} {one.strokes:7} {one.h0_nm:11.1f} "
                    f"{100 * one.h0_error:8.2f} {'yes' if one.h0_determined else 'no':>9} "
                    f"{100 * one.mu_error:11.2f} {sum(one.covered.values()):3} of "
                    f"{len(one.covered)} {one.fit_s:6.1f} {one.measure_s:7.1f}",
                    flush=True,
                )
    medians = {}
    for name in ("full", "short"):
        some = [one for one in trials if one.protocol == name]
        h0 = np.median([abs(one.h0_error) for one in some])
        mu = np.median([one.mu_error for one in some])
        medians[name] = h0, mu
        print(
            f"\n{name}: median error of d1/eps1 {h0:.2%}, of mu {mu:.2%} (worst truth "
            f"{max(one.mu_error for one in some):.2%}); fit {max(o.fit_s for o in some):.1f} s at "
            f"most; d1/eps1 reported in {sum(o.h0_determined for o in some)} of {len(some)}"
        )
        for parameter in some[0].covered:
            share = np.mean([one.covered[parameter] for one in some])
            print(f"  90 % interval of {parameter}: holds the truth in {share:.0%}")
        every = [inside for one in some for inside in one.covered.values()]
        print(f"  of all: {np.mean(every):.0%}")
    ratios = [short / full for short, full in zip(medians["short"], medians["full"], strict=True)]
    print(f"\nshort over full: d1/eps1 {ratios[0]:.2f}, mu {ratios[1]:.2f}")


if __name__ == "__main__":
    main()
