"""Friction against normal force (paper, Fig. 3C), with and without the finite size."""

from __future__ import annotations

import numpy as np
import torch

from haptix.electro.breakdown import NARROW_GAP_FIELD_V_PER_M
from haptix.figures.data import (
    COLD_TO_HOT,
    Array,
    Curve,
    FigureData,
    Mark,
    Panel,
    basis,
    light_contact,
    numbers,
    sentence_list,
)
from haptix.finger import Finger
from haptix.friction import ContactModel
from haptix.screen import Screen

VOLTAGES_V = (0.0, 50.0, 100.0, 150.0, 200.0)
H0_M = 0.2e-6
_FORCES_N = np.linspace(0.1, 1.0, 361)
_SAME = 1e-6  # relative difference in mu below which the finite size makes no difference


def friction_against_force(
    finger: Finger | None = None, screen: Screen | None = None
) -> FigureData:
    """Friction coefficient against F_N from 0.1 to 1 N, V0 from 0 to 200 V, at h0 = 0.2 um.

    Parameters
    ----------
    finger, screen : Finger, Screen, optional
        What touches what; the semi-wet finger on the paper's screen without.
    """
    finger = finger or Finger.preset("semi-wet")
    screen = screen or Screen.preset("3m-sct3250")
    # Without a frequency h0 is that of the paper, skin included.
    terms = {"finite-size": True, "skin-dielectric": False, "breakdown": True}
    model = ContactModel(finger, screen, terms=terms)
    infinite = ContactModel(finger, screen, terms={**terms, "finite-size": False})
    force, voltage = torch.from_numpy(_FORCES_N)[:, None], torch.tensor(VOLTAGES_V)
    states = model.solve(force, voltage, h0_m=H0_M)
    bounds = infinite.solve(force, voltage, h0_m=H0_M)
    columns = {"normal_force_n": _FORCES_N}
    columns |= {
        f"mu_{v:g}v": light_contact(states.mu[:, k], states.status[:, k])
        for k, v in enumerate(VOLTAGES_V)
    }
    columns |= {
        f"mu_without_finite_size_{v:g}v": light_contact(bounds.mu[:, k], bounds.status[:, k])
        for k, v in enumerate(VOLTAGES_V)
    }
    columns |= {f"status_{v:g}v": numbers(states.status[:, k]) for k, v in enumerate(VOLTAGES_V)}
    curves, marks, kinks = [], [], []
    for v, color in zip(VOLTAGES_V, COLD_TO_HOT, strict=False):
        solid, thin = f"mu_{v:g}v", f"mu_without_finite_size_{v:g}v"
        curves.append(Curve("normal_force_n", solid, f"{v:g} V", color))
        if v > 0:
            curves.append(Curve("normal_force_n", thin, color=color, style="--", width=0.9))
        row = _kink(columns[solid], columns[thin])
        if row is not None:
            marks.append(
                Mark(_FORCES_N[row], columns[solid][row], "o", "kink: finite size sets in", color)
            )
            kinks.append(f"{_FORCES_N[row]:.2f} N at {v:g} V")
    # Lies under the curve of 0 V, which has no finite size: there for its line in the legend.
    thin = f"mu_without_finite_size_{VOLTAGES_V[0]:g}v"
    curves.append(Curve("normal_force_n", thin, "infinite size", "0.35", style="--", width=0.9))
    drawn = np.concatenate([columns[curve.y] for curve in curves])
    caption = (
        "Friction coefficient against normal force for voltage amplitudes of 0 to 200 V at "
        f"h0 = {H0_M * 1e6:g} µm; E = {float(finger.youngs_modulus_pa) / 1e6:g} MPa, "
        f"d = {float(finger.layer_thickness_m) * 1e6:g} µm, "
        f"{_bulk(finger)}"
        f"tau_f = {float(finger.frictional_shear_stress_pa) / 1e6:g} MPa. Solid: the gaps of a "
        "contact of finite size stop widening at the height of its highest asperity; dashed: "
        f"infinite size. {_kinks(kinks)}The field at the edges of contact spots is V0/h0: it "
        f"passes the {NARROW_GAP_FIELD_V_PER_M / 1e6:g} V/µm that narrow gaps bear at "
        f"{NARROW_GAP_FIELD_V_PER_M * H0_M:.0f} V; beyond, the curves hold without sparks. "
        + basis(model)
    )
    return FigureData(
        name="fig3c",
        title="Friction coefficient against normal force",
        caption=caption,
        columns=columns,
        panels=(
            Panel(
                r"normal force $F_\mathrm{N}$ (N)",
                r"friction coefficient $\mu$",
                tuple(curves),
                tuple(marks),
                x_range=(0.0, 1.02),
                y_range=(0.85 * float(np.nanmin(drawn)), 1.04 * float(np.nanmax(drawn))),
                legend_title="amplitude $V_\\mathrm{0}$",
            ),
        ),
    )


def _kink(finite: Array, infinite: Array) -> int | None:
    """Row of the highest force at which the finite size still matters."""
    matters = np.flatnonzero(np.abs(finite / infinite - 1) > _SAME)
    return int(matters[-1]) if len(matters) else None


def _bulk(finger: Finger) -> str:
    modulus = finger.bulk_modulus_pa
    return "" if modulus is None else f"E_bulk = {float(modulus) / 1e3:g} kPa, "


def _kinks(kinks: list[str]) -> str:
    return f"The kinks lie at {sentence_list(kinks)}. " if kinks else ""
