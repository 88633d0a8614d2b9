"""Felt strength of the six effects over screens and fingers, and which cannot give it.

    python benchmarks/effects.py [--fingers 20] [--screens 5] [--seed 38]

Each effect is played while a virtual finger slides with 0.5 N at 80 mm/s. Its strength is the
largest rise of felt friction over that without voltage, in just-noticeable differences of 0.11.
The effects' contrast was chosen for the preset of a semi-wet finger on one screen; these fingers
and screens are drawn around the three presets.
"""

import argparse
import warnings
from typing import get_args

import numpy as np
import torch

import haptix
from haptix.materials import WebEffect
from haptix.materials.timeline import EffectName
from haptix.motion import Trajectory
from haptix.population import Population
from haptix.simulation import Setting, simulate

SPREAD = {
    "frictional_shear_stress_pa": 0.3,
    "youngs_modulus_pa": 0.3,
    "roughness.h_rms_m": 0.1,
}
JND = 0.11
FORCE_N = 0.5


def screens(count):
    """The preset with insulators of 0.5 to 2 times its thickness."""
    preset = haptix.Screen.preset("3m-sct3250")
    for ratio in np.geomspace(0.5, 2.0, count):
        yield preset.replace(insulator_thickness_m=float(ratio * preset.insulator_thickness_m))


def fingers(count, seed):
    """As even a share of each preset as there can be."""
    for number, name in enumerate(("semi-wet", "wet", "dry")):
        size = (count + 2 - number) // 3
        yield from Population.around(haptix.Finger.preset(name), size, SPREAD, seed).fingers


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fingers", type=int, default=20)
    parser.add_argument("--screens", type=int, default=5)
    parser.add_argument("--seed", type=int, default=38)
    options = parser.parse_args()
    torch.set_num_threads(1)
    warnings.simplefilter("ignore")  # of presets
    names = get_args(EffectName)
    strengths: list[np.ndarray] = []
    reachable: list[float] = []
    t = np.arange(0, 0.5, 0.01)
    path = Trajectory(t, 80 * t, np.full_like(t, 5.0), np.full_like(t, FORCE_N))
    for screen in screens(options.screens):
        for finger in fingers(options.fingers, options.seed):
            model = haptix.ContactModel(finger, screen)
            axes = {"normal_force_n": FORCE_N, "frequency_hz": 4000.0}
            surface = haptix.FrictionSurface.build(model, axes, tolerance=1e-3)
            found = [simulate(Setting(model, WebEffect(name=n), path), surface) for n in names]
            rises = [np.nanmax(one.felt.mu / one.lowest_mu) - 1 for one in found]
            strengths.append(np.array(rises) / JND)
            reachable.append(float((found[0].highest_mu / found[0].lowest_mu).max()) - 1)
    strength, most = np.array(strengths), np.array(reachable) / JND
    print(
        f"{len(most)} pairs of finger and screen; "
        f"reachable {most.min():.2f} to {most.max():.2f} JND"
    )
    for number, name in enumerate(names):
        asked = np.max(WebEffect(name=name).timeline.value) / JND
        can = most >= asked
        felt = strength[can, number]
        spread = f"{felt.min():.2f} to {felt.max():.2f}" if can.any() else "none"
        equal = np.sum(np.abs(strength[:, number] - asked) <= 0.5)
        share = f"{can.sum()} can give it: felt {spread}"
        print(f"{name:8} asked {asked:.2f} JND; {share}; within 0.5 JND of it: {equal}")


if __name__ == "__main__":
    main()
