"""Felt strength of the six effects over screens and fingers, and which cannot give it.

    python benchmarks/effects.py [--fingers 20] [--screens 5] [--seed 38]

Each effect is played while a virtual finger slides with 0.5 N at 80 mm/s. Its strength is the
largest rise of felt friction over that without voltage, in just-noticeable differences of 0.11.
The effects' contrast was chosen for the preset of a semi-wet finger on one screen; these fingers
and screens are drawn around the three presets. The renderer first knows each finger, then it takes
each for the preset that it was drawn around. A hundred pairs take ten minutes of a processor.
"""

import argparse
import warnings
from typing import get_args

import numpy as np
import torch

import haptix
from haptix.feel.materials import WebEffect
from haptix.feel.materials.timeline import EffectName
from haptix.feel.motion import Trajectory
from haptix.lab.population import Population
from haptix.play.simulation import Setting, simulate

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
    """As even a share of each preset as there can be; with the preset."""
    for number, name in enumerate(("semi-wet", "wet", "dry")):
        preset, size = haptix.Finger.preset(name), (count + 2 - number) // 3
        for finger in Population.around(preset, max(size, 2), SPREAD, seed).fingers[:size]:
            yield preset, finger


def surface_of(finger, screen):
    axes = {"normal_force_n": FORCE_N, "frequency_hz": 4000.0}
    model = haptix.ContactModel(finger, screen)
    return haptix.FrictionSurface.build(model, axes, tolerance=1e-3)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fingers", type=int, default=20)
    parser.add_argument("--screens", type=int, default=5)
    parser.add_argument("--seed", type=int, default=38)
    options = parser.parse_args()
    torch.set_num_threads(1)
    warnings.simplefilter("ignore")  # of presets
    effects = [WebEffect(name=name) for name in get_args(EffectName)]
    t = np.arange(0, 0.5, 0.01)
    path = Trajectory(t, 80 * t, np.full_like(t, 5.0), np.full_like(t, FORCE_N))
    strengths: dict[str, list[list[float]]] = {"known": [], "taken for its preset": []}
    reachable: list[float] = []
    for screen in screens(options.screens):
        of_preset: dict[str, haptix.FrictionSurface] = {}
        for preset, finger in fingers(options.fingers, options.seed):
            model = haptix.ContactModel(finger, screen)
            if preset.name not in of_preset:
                of_preset[preset.name] = surface_of(preset, screen)
            surface = surface_of(finger, screen)
            for known, felt in zip(
                (surface, of_preset[preset.name]), strengths.values(), strict=True
            ):
                found = [simulate(Setting(model, effect, path), known) for effect in effects]
                if known is surface:
                    lowest_mu = found[0].lowest_mu.min()
                    reachable.append(float(found[0].highest_mu.max() / lowest_mu - 1) / JND)
                felt.append([(np.nanmax(one.felt.mu) / lowest_mu - 1) / JND for one in found])
    most = np.array(reachable)
    print(
        f"{len(most)} pairs of finger and screen, {most.min():.2f} to {most.max():.2f} JND in reach"
    )
    for how, rows in strengths.items():
        print(f"the finger is {how}; all in JND")
        print("effect   asked  pairs that can: felt  within 0.5  the others: felt  within 0.5")
        for effect, felt in zip(effects, np.array(rows).T, strict=True):
            asked, line = effect.timeline.value.max() / JND, ""
            for those in (most >= asked, most < asked):
                rises = felt[those]
                extent = f"{rises.min():.2f} to {rises.max():.2f}" if len(rises) else "-"
                equal = np.sum(np.abs(rises - asked) <= 0.5)
                line += f"  {extent:>12}  {equal} of {len(rises)}"
            print(f"{effect.name:8} {asked:5.2f}{line}")


if __name__ == "__main__":
    main()
