"""Constant stimuli about a detection threshold: make the set, play it to a simulated observer, fit.

    python examples/constant_stimuli.py [folder]

Writes a folder of drive files with everything that a lab needs beside them, then runs the same
levels on the mock device, two intervals a trial, and fits the psychometric function.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import haptix
from firmware_io import open_device
from haptix.feel import Sine
from haptix.lab import (
    ConstantStimuli,
    Experiment,
    SimulatedObserver,
    Stimulus,
    StimulusSet,
    TrialPlan,
)
from haptix.lab.experiment.recipe import presentation_of
from haptix.lab.stimuli.designs import constant_stimuli

STEPS_DB = [-9, -6, -3, 0, 3, 6]
THRESHOLD = 0.03  # contrast of friction, which the experiment has to find


def stimulus(name: str, contrast: float) -> Stimulus:
    """A 40 Hz rise and fall of friction, faded in and out."""
    tone = (Sine(contrast / 2, 40.0) + contrast / 2).lasting(0.4).window(0.05)
    return Stimulus(name, tone, "contrast", normal_force_n=0.5)


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(tempfile.mkdtemp()) / "constant"
    finger, screen = haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    stimuli = tuple(constant_stimuli("tone", stimulus, THRESHOLD, STEPS_DB))
    parts = StimulusSet("constant", stimuli, finger, (screen,), trials=TrialPlan(10, 1.0, seed=1))
    made = parts.make(folder)
    for table in made.sidecars:
        print(
            f"{table['file']}: contrast {table['conditions']['amplitude']:.4f}, "
            f"{table['peak_v']:.1f} V, placeholders: {', '.join(table['placeholders'])}"
        )

    surface = parts.apparatus(screen).surfaces[0]
    response = surface.column(0.5, 4000.0)
    device = open_device("mock:")
    rate = device.capabilities.sample_rate_hz
    method = ConstantStimuli(STEPS_DB, repeats=30, seed=2)
    observer = SimulatedObserver(threshold=0.0, slope=3.5, seed=3)
    target = presentation_of(stimulus("target", THRESHOLD), response, rate)
    log = folder / "trials.tsv"
    experiment = Experiment(method, target, device, observer, log, wait=lambda seconds: None)
    experiment.run()
    device.close()
    found = method.estimate()
    print(
        f"{experiment.trials} trials in {log}: threshold {found.threshold:+.2f} dB "
        f"(95 %: {found.low:+.2f} to {found.high:+.2f} dB; the observer's is 0 dB), "
        f"slope {found.others['slope']:.1f}"
    )


if __name__ == "__main__":
    main()
