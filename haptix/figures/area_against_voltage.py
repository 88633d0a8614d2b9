"""Contact area against voltage for insulators of several thicknesses (paper, Fig. 3D)."""

from __future__ import annotations

import numpy as np
import torch

from haptix.electro.breakdown import NARROW_GAP_FIELD_V_PER_M
from haptix.figures.data import (
    COLD_TO_HOT,
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
from haptix.status import Status

H0_UM = (0.03, 0.05, 0.1, 0.2, 0.5, 1.0)
PRESSURE_PA, MODULUS_PA = 10e3, 100e6
_VOLTAGE_V = np.linspace(0.0, 200.0, 401)
_BEFORE = 1 - 1e-6  # a hair before pull-in the contact is still light: the curve's last point


def area_against_voltage(finger: Finger | None = None, screen: Screen | None = None) -> FigureData:
    """A/A0 against V0 from 0 to 200 V at p0 = 10 kPa and E = 100 MPa.

    Parameters
    ----------
    finger, screen : Finger, Screen, optional
        What touches what, but for modulus and apparent area; the semi-wet finger on the paper's
        screen without.
    """
    finger = (finger or Finger.preset("semi-wet")).replace(
        youngs_modulus_pa=MODULUS_PA,
        apparent_area_at_1n_m2=1.0 / PRESSURE_PA,  # so that 1 N presses with p0
        apparent_area_exponent=0.0,
    )
    model = ContactModel(
        finger,
        screen or Screen.preset("3m-sct3250"),
        terms={"skin-dielectric": False, "breakdown": True},
    )
    h0 = torch.tensor(H0_UM, dtype=torch.float64) * 1e-6
    pull_in = numbers(model.solve(1.0, 0.0, h0_m=h0).pull_in_voltage_v)
    reached = pull_in < _VOLTAGE_V[-1]
    voltage = np.unique(np.concatenate([_VOLTAGE_V, _BEFORE * pull_in[reached]]))
    states = model.solve(1.0, torch.from_numpy(voltage)[:, None], h0_m=h0)
    columns = {"voltage_v": voltage}
    curves, increases, marks, snapped = [], [], [], []
    for k, (thickness, color) in enumerate(zip(H0_UM, reversed(COLD_TO_HOT), strict=True)):
        area = light_contact(states.area_fraction[:, k], states.status[:, k])
        more = 100 * (area / area[0] - 1)
        name = f"h0_{thickness:g}um"
        columns[f"area_fraction_{name}"] = area
        columns[f"increase_percent_{name}"] = np.where(voltage > 0, more, np.nan)
        columns[f"status_{name}"] = numbers(states.status[:, k])
        curves.append(Curve("voltage_v", f"area_fraction_{name}", color=color))
        increases.append(Curve("voltage_v", f"increase_percent_{name}", f"{thickness:g} µm", color))
        broken = np.flatnonzero(columns[f"status_{name}"] == Status.BREAKDOWN)
        notes = [(int(broken[0]), "o", "gap field passes\n350 V/µm")] if len(broken) else []
        if reached[k]:
            notes.append((int(np.flatnonzero(~np.isnan(area))[-1]), "X", "pull-in"))
            snapped.append(f"{pull_in[k]:.0f} V for {thickness:g} µm")
        marks += [(row, shape, label, color, area[row], more[row]) for row, shape, label in notes]
    areas = np.concatenate([columns[curve.y] for curve in curves])
    areas = areas[~np.isnan(areas)]
    caption = (
        "Left: real over apparent contact area against voltage amplitude for several effective "
        f"thicknesses h0 of the insulator, at p0 = {PRESSURE_PA / 1e3:g} kPa and "
        f"E = {MODULUS_PA / 1e6:g} MPa. Right: its increase over the area without voltage. "
        + (
            f"Crosses: the light contact snaps in at {sentence_list(snapped)}; nothing is drawn "
            "beyond. "
            if snapped
            else ""
        )
        + f"Circles: from here on the field V0/h0 at the edges of contact spots is above the "
        f"{NARROW_GAP_FIELD_V_PER_M / 1e6:g} V/µm that narrow gaps bear, and the curve holds "
        "without sparks only. " + basis(model)
    )
    return FigureData(
        name="fig3d",
        title="Contact area against voltage and insulator thickness",
        caption=caption,
        columns=columns,
        panels=(
            Panel(
                "voltage amplitude $V_\\mathrm{0}$ (V)",
                "$A/A_\\mathrm{0}$",
                tuple(curves),
                tuple(
                    Mark(voltage[row], area, shape, label, color)
                    for row, shape, label, color, area, _ in marks
                ),
                y_scale="log",
                x_range=(0, 200),
                y_range=(10 ** np.floor(np.log10(areas.min())), 1.5 * areas.max()),
                has_legend=False,
            ),
            Panel(
                "voltage amplitude $V_\\mathrm{0}$ (V)",
                "increase of $A/A_\\mathrm{0}$ (%)",
                tuple(increases),
                tuple(
                    Mark(voltage[row], more, shape, label, color)
                    for row, shape, label, color, _, more in marks
                ),
                y_scale="log",
                x_range=(0, 200),
                y_range=(1e-2, 5e3),
                legend_title=r"$h_\mathrm{0}$",
            ),
        ),
    )
