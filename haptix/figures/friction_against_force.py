"""Friction against normal force (paper, Fig. 3C), with and without the finite size."""

from __future__ import annotations

import numpy as np
import torch
from matplotlib.axes import Axes

from haptix.electro.breakdown import NARROW_GAP_FIELD_V_PER_M
from haptix.figures import data, drawing
from haptix.finger import Finger
from haptix.friction import ContactModel
from haptix.screen import Screen

VOLTAGES_V = (0.0, 50.0, 100.0, 150.0, 200.0)
H0_M = 0.2e-6
_FORCES_N = np.linspace(0.1, 1.0, 361)
_SAME = 1e-6  # relative difference in mu below which the finite size has no effect


def friction_against_force() -> data.FigureData:
    """Friction coefficient against F_N from 0.1 to 1 N, V0 from 0 to 200 V, at h0 = 0.2 um."""
    finger, screen = Finger.preset("semi-wet"), Screen.preset("3m-sct3250")
    # Without a frequency h0 is that of the paper, skin included.
    terms = {"finite-size": True, "skin-dielectric": False, "breakdown": True}
    model = ContactModel(finger, screen, terms=terms)
    infinite = ContactModel(finger, screen, terms={**terms, "finite-size": False})
    force, voltage = torch.from_numpy(_FORCES_N)[:, None], torch.tensor(VOLTAGES_V)
    states = model.solve(force, voltage, h0_m=H0_M)
    bounds = infinite.solve(force, voltage, h0_m=H0_M)
    solid, dashed = (data.light_contact(found.mu, found.status) for found in (states, bounds))
    status = data.numbers(states.status)
    columns = {"normal_force_n": _FORCES_N}
    columns |= {f"mu_{v:g}v": mu for v, mu in zip(VOLTAGES_V, solid.T, strict=True)}
    columns |= {
        f"mu_without_finite_size_{v:g}v": mu for v, mu in zip(VOLTAGES_V, dashed.T, strict=True)
    }
    columns |= {f"status_{v:g}v": found for v, found in zip(VOLTAGES_V, status.T, strict=True)}
    # At each voltage the highest force, as a row, at which the finite size still matters.
    kinks = {
        k: int(np.flatnonzero(differs)[-1])
        for k, differs in enumerate((np.abs(solid / dashed - 1) > _SAME).T)
        if differs.any()
    }

    def plot(axes: Axes) -> None:
        for k, (v, color) in enumerate(zip(VOLTAGES_V, data.COLD_TO_HOT, strict=False)):
            axes.plot(_FORCES_N, solid[:, k], color=color, label=f"{v:g} V")
            if v > 0:
                axes.plot(_FORCES_N, dashed[:, k], "--", color=color, lw=0.9, zorder=1.9)
        # Lies under the curve of 0 V, which has no finite size: there for its line in the legend.
        axes.plot(
            _FORCES_N, dashed[:, 0], "--", color="0.35", lw=0.9, zorder=1.9, label="infinite size"
        )
        for k, row in kinks.items():
            drawing.mark(axes, _FORCES_N[row], solid[row, k], "o", "kink: finite size sets in",
                 data.COLD_TO_HOT[k])  # fmt: skip
        drawn = np.stack([solid, dashed])
        axes.set(xlabel=r"normal force $F_\mathrm{N}$ (N)", ylabel=r"friction coefficient $\mu$")
        axes.set(xlim=(0.0, 1.02), ylim=(0.85 * drawn.min(), 1.04 * drawn.max()))

    places = [f"{_FORCES_N[row]:.2f} N at {VOLTAGES_V[k]:g} V" for k, row in kinks.items()]
    caption = (
        "Friction coefficient against normal force for voltage amplitudes of 0 to 200 V at "
        f"h0 = {H0_M * 1e6:g} µm; E = {float(finger.youngs_modulus_pa) / 1e6:g} MPa, "
        f"d = {float(finger.layer_thickness_m) * 1e6:g} µm, "
        f"E_bulk = {float(finger.bulk_modulus_pa or 0.0) / 1e3:g} kPa, "
        f"tau_f = {float(finger.frictional_shear_stress_pa) / 1e6:g} MPa. Solid: the gaps of a "
        "contact of finite size stop widening at the height of its highest asperity; dashed: "
        f"infinite size. The kinks lie at {data.sentence_list(places)}. The field at the edges of "
        f"contact spots is V0/h0: it passes {data.NARROW_GAPS_BEAR} at "
        f"{NARROW_GAP_FIELD_V_PER_M * H0_M:.0f} V; beyond, the curves hold without sparks. "
        + data.basis(model)
    )
    title, legend = "Friction coefficient against normal force", "amplitude $V_\\mathrm{0}$"
    return data.FigureData("fig3c", title, caption, columns, plot, legend_title=legend)
