"""Presets of fingers and screens and the names of the terms, known before torch loads."""

from __future__ import annotations

from collections.abc import Callable, Collection
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field

from haptix.base.fields import ProfileName, is_there, one_of

DEFAULT_CARRIER_HZ = 4000.0
"""Carrier where none is named: too fast to be felt, and exactly a twelfth of 48 kHz."""

FORCES_N = (0.05, 3.0)
"""Range of forces of a surface that is built for whoever strokes the screen."""

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


TERM_NAMES = (
    "layered-skin",
    "apparent-area",
    "finite-size",
    "plasticity",
    "skin-dielectric",
    "leaky-gap",
    "field-limit",
    "body-return",
    "breakdown",
    "occlusion",
    "sliding-speed",
    "shear-area",
)
"""Names of the classes of `haptix.model.terms`, which loads torch, in the order of their action."""


def preset_or_file(presets: Collection[str]) -> Callable[[str], str]:
    """Return a check that refuses a name of neither a preset nor an existing TOML file."""

    def check(value: str) -> str:
        if value.endswith(".toml"):
            return str(is_there(Path(value)))
        if value not in presets:
            near = get_close_matches(value.lower(), presets, 1)
            raise ValueError(
                f"unknown preset {value!r:.80}: expected one of {', '.join(presets)}, or a file "
                f"whose name ends in .toml{f'; did you mean {near[0]}?' if near else ''}"
            )
        return value

    return check


FingerName = Annotated[str, AfterValidator(preset_or_file(FINGERS)), ProfileName(tuple(FINGERS))]


ScreenName = Annotated[str, AfterValidator(preset_or_file(SCREENS)), ProfileName(tuple(SCREENS))]


TermName = Annotated[
    str, AfterValidator(one_of(*TERM_NAMES)), Field(json_schema_extra={"enum": [*TERM_NAMES]})
]


PULL_PAST_BREAKDOWN = 0.5
"""Outputs warn if at least this share of the attraction comes from gaps past their breakdown."""


def breakdown_note(share: float) -> str:
    """Return the part of a title about the largest `ContactState.pull_past_breakdown`."""
    if share < PULL_PAST_BREAKDOWN:
        return ""
    return (
        f"; warning: up to {share:.0%} of the attraction comes from gaps whose field is past what "
        "they bear: on a real screen they spark or leak, and its friction is likely to be lower (a "
        "mock driver has no voltage)"
    )
