"""Friction against normal force (paper, Fig. 3C), by the usual model and as published."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch

from haptix.electro.breakdown import NARROW_GAP_FIELD_V_PER_M
from haptix.figures import data
from haptix.finger import Finger
from haptix.friction import ContactModel
from haptix.screen import Screen

if TYPE_CHECKING:
    from matplotlib.axes import Axes

VOLTAGES_V = (0.0, 50.0, 100.0, 150.0, 200.0)
_FORCES_N = np.linspace(0.1, 1.0, 361)
_FORMS = ("mu", "mu_as_published")


def friction_against_force() -> data.FigureData:
    """Friction coefficient against F_N from 0.1 to 1 N, V0 from 0 to 200 V, at h0 = 0.2 um."""
    finger, screen = Finger.preset("semi-wet"), Screen.preset("3m-sct3250")
    models = (
        ContactModel(finger, screen, terms=data.AT_H0),
        ContactModel(
            finger, screen, terms={**data.AT_H0, "finite-size": True}, theory="as-published"
        ),
    )
    force, voltage = torch.from_numpy(_FORCES_N)[:, None], torch.tensor(VOLTAGES_V)
    columns = {"normal_force_n": _FORCES_N}
    curves = []
    for form, model in zip(_FORMS, models, strict=True):
        states = model.solve(force, voltage, h0_m=data.H0_M)
        mu = data.light_contact(states.mu, states.status)
        curves.append(mu)
        status = data.numbers(states.status)
        for k, v in enumerate(VOLTAGES_V):
            columns[f"{form}_{v:g}v"] = mu[:, k]
            columns[f"{form.replace('mu', 'status')}_{v:g}v"] = status[:, k]

    def plot(axes: Axes) -> None:
        usual, published = curves
        for k, (v, color) in enumerate(zip(VOLTAGES_V, data.COLD_TO_HOT, strict=False)):
            axes.plot(_FORCES_N, usual[:, k], color=color, label=f"{v:g} V")
            axes.plot(_FORCES_N, published[:, k], "--", color=color, lw=0.9, zorder=1.9)
        axes.plot([], [], "--", color="0.35", lw=0.9, label="as published")
        axes.set(xlabel=r"normal force $F_\mathrm{N}$ (N)", ylabel=r"friction coefficient $\mu$")
        axes.set(xlim=(0.0, 1.02))
        axes.set(ylim=(0.85 * np.nanmin(curves), 1.04 * np.nanmax(curves)))

    caption = (
        "Friction coefficient against normal force for voltage amplitudes of 0 to 200 V at "
        f"h0 = {data.H0_M * 1e6:g} µm; E = {float(finger.youngs_modulus_pa) / 1e6:g} MPa, "
        f"d = {float(finger.layer_thickness_m) * 1e6:g} µm, "
        f"E_bulk = {float(finger.bulk_modulus_pa or 0.0) / 1e3:g} kPa. Solid: the usual model; "
        f"{data.AS_QUERIED} Dashed: the theory as published, whose contact spots attract too, with "
        "its limit of finite size, h_rms sqrt(2 ln N): its gaps stop widening there, with a kink. "
        "Both have one friction without voltage at the paper's load. The field at the edges of "
        f"contact spots is V0/h0: it passes {data.NARROW_GAPS_BEAR} at "
        f"{NARROW_GAP_FIELD_V_PER_M * data.H0_M:.0f} V; beyond, the curves hold without sparks. "
        + data.basis(models[0])
    )
    title, legend = "Friction coefficient against normal force", "amplitude $V_\\mathrm{0}$"
    return data.FigureData("fig3c", title, caption, columns, plot, legend_title=legend)
