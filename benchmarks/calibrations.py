"""Calibration of 20 random fingers and screens, with known truth, on the virtual finger.

    python benchmarks/calibrations.py [--truths 20] [--processes 2] [--seed 0] [--hold-skin]

Each truth is measured by the full and by the short protocol: played by the contact model in time,
read with noise, drift and cross-talk by a finger that cannot hold force and speed, reduced, and
fitted from the same start. Fingers, their skin's dielectric included, are drawn from the priors of
the fits, screens of 70 to 300 nm evenly in the logarithm. With ``--hold-skin`` the fits hold the
dielectric at the assumed one, as those of version 0.1.
"""

from __future__ import annotations

import argparse
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

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
from calibration.practice import draw_parameters
from calibration.predict import StrokeConditions
from calibration.profile import finger_at
from calibration.recording import StrokeRecording

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
    h0_width: float
    skin_scale: float
    mu_error: float
    covered: dict[str, bool]
    fit_s: float
    measure_s: float


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


def run(number: int, seed: int, hold_skin: bool) -> list[Trial]:
    torch.set_num_threads(1)
    finger = haptix.Finger.preset("semi-wet")
    screen = haptix.Screen.preset("3m-sct3250").replace(name="panel")
    start = Parameters.of(finger, screen)
    predictor = StrokePredictor(haptix.ContactModel(finger, screen))
    truth = draw_parameters(start, np.random.default_rng([seed, number]))
    values = {name: truth[name].value for name in truth.names}
    volts = highest_voltage(predictor, truth)
    # The truth is a model of its own, not the predictor's scaled table.
    own = finger_at(finger, values)
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
        assumed = start.fixed(skin_dielectric_scale=1.0) if hold_skin else start
        fit = fit_strokes(reduced, predictor, assumed)
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
                float(np.log(fit["h0_m"].high / fit["h0_m"].low)) / 2,
                values["skin_dielectric_scale"],
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--truths", type=int, default=20)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--hold-skin", action="store_true")
    asked = parser.parse_args()
    print(
        "truth protocol strokes  skin  d1/eps1 nm  error %  +-90 %  reported  mu error %  covered  "
        "fit s  play s"
    )
    trials: list[Trial] = []
    with ProcessPoolExecutor(asked.processes) as pool:
        count = asked.truths
        for made in pool.map(run, range(count), [asked.seed] * count, [asked.hold_skin] * count):
            trials += made
            for one in made:
                print(
                    f"{one.truth:5} {one.protocol:8} {one.strokes:7} {one.skin_scale:5.2f} "
                    f"{one.h0_nm:11.1f} {100 * one.h0_error:8.2f} {100 * one.h0_width:7.2f} "
                    f"{'yes' if one.h0_determined else 'no':>9} "
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
