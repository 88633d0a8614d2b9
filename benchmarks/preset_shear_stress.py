"""The presets' tau_f: the paper's, carried over to the theory that is the default.

    .venv/bin/python benchmarks/preset_shear_stress.py

The paper gives tau_f for its own area (physics page, section 3). These numbers stand in
`Finger.presets`; run this again after a change of the theory "local". A dry finger's area is
that of its hardness in every theory, and its tau_f stays.
"""

from haptix import Finger
from haptix.model.friction import in_theory

PAPER_PA = {"semi-wet": 8e6, "wet": 5e6, "dry": 13e6}


def refitted() -> dict[str, float]:
    """tau_f [Pa] of each preset."""
    paper = {
        name: Finger.preset(name).replace(theory="open-gaps", frictional_shear_stress_pa=stress)
        for name, stress in PAPER_PA.items()
    }
    return {
        name: float(in_theory(finger, Finger.preset(name).theory).frictional_shear_stress_pa)
        for name, finger in paper.items()
    }


if __name__ == "__main__":
    for name, stress in refitted().items():
        stands = float(Finger.preset(name).frictional_shear_stress_pa)
        print(f"{name:9} {stress:.7g} Pa, {stress / PAPER_PA[name]:.4f} of the paper's; "
              f"the preset has {stands:.7g} Pa")  # fmt: skip
