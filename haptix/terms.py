"""The terms of the contact model that can be switched on and off by name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from haptix.errors import InputError
from haptix.finger import Finger
from haptix.screen import Screen


@dataclass(frozen=True)
class Term:
    """One term: what it does, where it comes from, and the fields of the profiles it uses."""

    summary: str
    source: str
    finger_fields: tuple[str, ...] = ()
    screen_fields: tuple[str, ...] = ()


PERSSON_2018 = "Ayyildiz, Scaraggi, Sirin, Basdogan, Persson, PNAS 115, 12668 (2018)"

TERMS: Mapping[str, Term] = {
    "layered-skin": Term(
        "stratum corneum bonded to soft tissue; off: a half-space of the stratum corneum",
        f"{PERSSON_2018}, SI; physics page, section 3",
        ("layer_thickness_m", "bulk_modulus_pa", "bulk_poisson_ratio"),
    ),
    "apparent-area": Term(
        "apparent contact area grows with force, A0 ~ F_N^m; off: its value at 1 N",
        f"{PERSSON_2018}: 3 kPa at 0.1 N, 20 kPa at 0.9 N",
        ("apparent_area_at_1n_m2", "apparent_area_exponent"),
    ),
    "finite-size": Term(
        "the mean gap cannot exceed the highest asperity of the apparent contact",
        "physics page, section 2: h_rms sqrt(2 ln N)",
        ("roughness", "apparent_area_at_1n_m2"),
    ),
    "plasticity": Term(
        "contact stress is cut off at the hardness, and the area that yields is added",
        "Persson, Phys. Rev. Lett. 87, 116101 (2001)",
        ("hardness_pa",),
    ),
    "skin-dielectric": Term(
        "the stratum corneum's d2/eps2(f) adds to h0, where a frequency is given",
        f"{PERSSON_2018}, Eq. 4",
        ("layer_thickness_m", "dielectric"),
    ),
    "leaky-gap": Term(
        "the gap conducts: eps_g = 1 + i/(w eps0 rho_g) multiplies h0",
        f"{PERSSON_2018}, Fig. 4; physics page, section 3",
        (),
        ("gap_resistivity_ohm_m",),
    ),
    "breakdown": Term(
        "report states whose field exceeds what air or the insulator bears",
        "physics page, section 3",
        (),
        ("insulator_thickness_m", "insulator_permittivity", "insulator_strength_v_per_m"),
    ),
}


def chosen_terms(
    terms: Iterable[str] | Mapping[str, bool] | None,
    finger: Finger,
    screen: Screen,
    fidelity: str,
) -> frozenset[str]:
    """Return the names of the terms that are on, checked against each other and the profiles.

    Parameters
    ----------
    terms : iterable of str, mapping, or None
        Names of all that are on; or a mapping that switches single ones, name to bool; or None for
        those that the profiles call for.
    """
    called_for = {"apparent-area", "skin-dielectric"}
    if finger.bulk_modulus_pa is not None:
        called_for.add("layered-skin")
    if finger.hardness_pa is not None and fidelity != "closed-form":
        called_for.add("plasticity")
    if screen.gap_resistivity_ohm_m is not None:
        called_for.add("leaky-gap")
    if terms is None:
        return frozenset(called_for)
    if isinstance(terms, str):
        raise InputError(f"terms: expected a set of names, such as {{{terms!r}}}, got a string")
    unknown = set(terms) - set(TERMS)
    if unknown:
        raise InputError(
            f"terms: unknown {', '.join(map(repr, sorted(unknown)))}; expected some of "
            f"{', '.join(TERMS)}"
        )
    if isinstance(terms, Mapping):
        on = called_for - {name for name, is_on in terms.items() if not is_on}
        on |= {name for name, is_on in terms.items() if is_on}
    else:
        on = set(terms)
    _check(on, finger, screen, fidelity)
    return frozenset(on)


def _check(on: set[str], finger: Finger, screen: Screen, fidelity: str) -> None:
    needed = {
        "layered-skin": ("finger.bulk_modulus_pa", finger.bulk_modulus_pa),
        "plasticity": ("finger.hardness_pa", finger.hardness_pa),
        "leaky-gap": ("screen.gap_resistivity_ohm_m", screen.gap_resistivity_ohm_m),
    }
    for name, (field, value) in needed.items():
        if name in on and value is None:
            raise InputError(
                f'terms: "{name}" needs {field}, which is None; set it or switch it off'
            )
    if fidelity == "closed-form":
        for name in ("finite-size", "plasticity"):
            if name in on:
                raise InputError(
                    f'terms: "{name}" contradicts fidelity "closed-form", which assumes light '
                    'elastic contact of infinite size; use "mean-field"'
                )
    if fidelity == "boundary-element" and "finite-size" in on:
        raise InputError(
            'terms: "finite-size" contradicts fidelity "boundary-element", whose box has a highest '
            'asperity of its own; switch it off, or use "mean-field"'
        )
