"""Names and fields of the presets, known without loading the classes that they describe."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

FINGERS: dict[str, dict[str, Any]] = {
    "semi-wet": {
        "bulk_modulus_pa": 10e3,
        "frictional_shear_stress_pa": 5.531446e6,
        "theory": "local",
    },
    "dry": {
        "theory": "local",
        "bulk_modulus_pa": 10e3,
        "youngs_modulus_pa": 1e9,
        "poisson_ratio": 0.3,
        "hardness_pa": 50e6,
        "frictional_shear_stress_pa": 13e6,
    },
    "wet": {
        "bulk_modulus_pa": 10e3,
        "youngs_modulus_pa": 10e6,
        "frictional_shear_stress_pa": 3.46451e6,
        "theory": "local",
    },
}

SCREENS: dict[str, dict[str, Any]] = {"3m-sct3250": {}}

TERMS = tuple(
    re.findall(
        r'^    name = "([\w-]+)"$',
        Path(__file__).with_name("terms.py").read_text(encoding="utf-8"),
        re.MULTILINE,
    )
)
"""Names of the terms of `haptix.terms.TERMS`, from its text, since importing it loads torch."""
