"""Contact area against voltage for insulators of several thicknesses (paper, Fig. 3D)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch

from haptix.figures import data, drawing
from haptix.finger import Finger
from haptix.friction import ContactModel
from haptix.screen import Screen
from haptix.status import Status

if TYPE_CHECKING:
    from matplotlib.axes import Axes

H0_UM = (0.03, 0.05, 0.1, 0.2, 0.5, 1.0)
PRESSURE_PA, MODULUS_PA = 10e3, 100e6
_VOLTAGE_V = np.linspace(0.0, 200.0, 401)
_BEFORE = 1 - 1e-6  # just before pull-in the contact is still light: the curve's last point


def area_against_voltage() -> data.FigureData:
    """A/A0 against V0 from 0 to 200 V at p0 = 10 kPa and E = 100 MPa."""
    finger = Finger.preset("semi-wet").replace(
        youngs_modulus_pa=MODULUS_PA,
        apparent_area_at_1n_m2=1.0 / PRESSURE_PA,  # so that 1 N presses with p0
        apparent_area_exponent=0.0,
    )
    terms = {"skin-dielectric": False, "breakdown": True}
    model = ContactModel(finger, Screen.preset("3m-sct3250"), terms=terms)
    h0 = torch.tensor(H0_UM, dtype=torch.float64) * 1e-6
    pull_in = data.numbers(model.solve(1.0, 0.0, h0_m=h0).pull_in_voltage_v)
    reached = pull_in < _VOLTAGE_V[-1]
    voltage = np.unique(np.concatenate([_VOLTAGE_V, _BEFORE * pull_in[reached]]))
    states = model.solve(1.0, torch.from_numpy(voltage)[:, None], h0_m=h0)
    columns = {"voltage_v": voltage}
    marks: list[tuple[int, int, str, str]] = []  # insulator, row, shape, label
    for k, thickness in enumerate(H0_UM):
        name = f"h0_{thickness:g}um"
        area = data.light_contact(states.area_fraction[:, k], states.status[:, k])
        increase = 100 * (area / area[0] - 1)
        columns[f"area_fraction_{name}"] = area
        columns[f"increase_percent_{name}"] = np.where(voltage > 0, increase, np.nan)
        status = columns[f"status_{name}"] = data.numbers(states.status[:, k])
        if (broken := np.flatnonzero(status == Status.BREAKDOWN)).size:
            marks.append((k, int(broken[0]), "o", "gap field passes\n350 V/µm"))
        if reached[k]:
            marks.append((k, int(np.flatnonzero(~np.isnan(area))[-1]), "X", "pull-in"))

    def plot(left: Axes, right: Axes) -> None:
        for axes, quantity in ((left, "area_fraction"), (right, "increase_percent")):
            drawn = [columns[f"{quantity}_h0_{thickness:g}um"] for thickness in H0_UM]
            for y, thickness, color in zip(drawn, H0_UM, reversed(data.COLD_TO_HOT), strict=True):
                axes.plot(voltage, y, color=color, label=f"{thickness:g} µm")
            for k, row, shape, label in marks:
                drawing.mark(
                    axes, voltage[row], drawn[k][row], shape, label, data.COLD_TO_HOT[-1 - k]
                )
            axes.set(xlabel="voltage amplitude $V_\\mathrm{0}$ (V)", xlim=(0, 200), yscale="log")
        areas = np.stack([columns[f"area_fraction_h0_{thickness:g}um"] for thickness in H0_UM])
        lowest = 10 ** np.floor(np.log10(np.nanmin(areas)))
        left.set(ylabel="$A/A_\\mathrm{0}$", ylim=(lowest, 1.5 * np.nanmax(areas)))
        right.set(ylabel="increase of $A/A_\\mathrm{0}$ (%)", ylim=(1e-2, 5e3))

    snapped = [f"{pull_in[k]:.0f} V for {H0_UM[k]:g} µm" for k in np.flatnonzero(reached)]
    caption = (
        "Left: real over apparent contact area against voltage amplitude for several effective "
        f"thicknesses h0 of the insulator, at p0 = {PRESSURE_PA / 1e3:g} kPa and "
        f"E = {MODULUS_PA / 1e6:g} MPa. Right: its increase over the area without voltage. "
        f"Crosses: the light contact snaps in at {data.sentence_list(snapped)}; nothing is drawn "
        "beyond. Circles: from here on the field V0/h0 at the edges of contact spots is above "
        f"{data.NARROW_GAPS_BEAR}, and the curve holds without sparks only. {data.basis(model)}"
    )
    title = "Contact area against voltage and insulator thickness"
    return data.FigureData("fig3d", title, caption, columns, plot, (1, 2), r"$h_\mathrm{0}$")
