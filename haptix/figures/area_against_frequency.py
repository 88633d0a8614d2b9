"""Contact area against the drive's frequency, with air gaps that leak (paper, Fig. 4)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch

from haptix.electro import SkinDielectric
from haptix.errors import from_extra
from haptix.figures import data, drawing
from haptix.finger import Finger
from haptix.friction import ContactModel
from haptix.screen import Screen
from haptix.status import Status

with from_extra("figures"):
    from matplotlib.ticker import EngFormatter

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FORCE_N, VOLTAGE_V = 0.5, 100.0
_GAPS = {"dry_gap": None} | {f"leaky_gap_1e{n}_ohm_m": 10.0**n for n in (7, 6, 5)}
_COLORS = (data.COLD_TO_HOT[0], data.COLD_TO_HOT[2], data.COLD_TO_HOT[3], data.COLD_TO_HOT[4])
_FREQUENCY_HZ = np.geomspace(1.0, 1e6, 361)


def area_against_frequency() -> data.FigureData:
    """A_on/A_off against f from 1 Hz to 1 MHz at 0.5 N and 100 V, d1 = 1 um, eps1 = 8."""
    finger = Finger.preset("semi-wet")
    frequency = torch.from_numpy(_FREQUENCY_HZ)
    columns = {"frequency_hz": _FREQUENCY_HZ}
    models, ratios, tops = {}, {}, {}
    for name, resistivity in _GAPS.items():
        screen = Screen(
            name="Fig. 4",
            insulator_thickness_m=1e-6,
            insulator_permittivity=8.0,
            gap_resistivity_ohm_m=resistivity,
        )
        model = models[name] = ContactModel(finger, screen, terms={"breakdown": True})
        on = model.solve(FORCE_N, VOLTAGE_V, frequency)
        off = model.solve(FORCE_N, 0.0, frequency)
        ratios[name] = data.light_contact(on.area_fraction / off.area_fraction, on.status)
        columns[f"area_on_over_off_{name}"] = ratios[name]
        columns[f"status_{name}"] = data.numbers(on.status)
        if resistivity is not None:
            tops[name] = int(np.nanargmax(ratios[name]))

    def plot(axes: Axes) -> None:
        for (name, resistivity), color in zip(_GAPS.items(), _COLORS, strict=True):
            label = "no leakage"
            if resistivity is not None:
                label = rf"$\mathrm{{10}}^{np.log10(resistivity):.0f}$ Ωm"
            axes.plot(_FREQUENCY_HZ, ratios[name], color=color, label=label)
        for (name, top), color in zip(tops.items(), _COLORS[1:], strict=True):
            drawing.mark(axes, _FREQUENCY_HZ[top], ratios[name][top], "o", "maximum", color)
        axes.set(xlabel="frequency $f$ (Hz)", xscale="log", xlim=_FREQUENCY_HZ[[0, -1]])
        axes.set(ylabel=r"$A_\mathrm{on}/A_\mathrm{off}$")

    dry = ratios["dry_gap"]
    highest = [
        f"{ratios[n][top]:.3f} at {_with_unit(_FREQUENCY_HZ[top])}" for n, top in tops.items()
    ]
    broken = _FREQUENCY_HZ[columns["status_dry_gap"] == Status.BREAKDOWN]
    assert isinstance(finger.dielectric, SkinDielectric)  # that of the presets
    table = finger.dielectric.frequency_hz
    caption = (
        "Real contact area with voltage over that without, against the frequency of the drive, at "
        f"F_N = {FORCE_N:g} N and V0 = {VOLTAGE_V:g} V; d1 = 1 µm, eps1 = 8, "
        f"d2 = {float(finger.layer_thickness_m) * 1e6:g} µm. Without leakage the ratio is largest "
        f"at low frequencies, {dry[0]:.3f} at {_FREQUENCY_HZ[0]:g} Hz, where the skin conducts. A "
        "gap of finite resistivity lets the charge across at low frequencies, and a maximum "
        f"appears: {data.sentence_list(highest)} for 1e7, 1e6 and 1e5 Ohm m. "
        f"Up to {_with_unit(broken[-1])} the field in the dry gap passes {data.NARROW_GAPS_BEAR}, "
        "and its curve holds without sparks. The table of the skin's dielectric reaches from "
        f"{_with_unit(table[0])} to {_with_unit(table[-1])} and is held at its last values beyond. "
        f"{data.basis(models['dry_gap'], also_on='leaky-gap for the gaps that leak')}"
    )
    title, legend = "Contact area against frequency", "resistivity of the gap"
    return data.FigureData("fig4", title, caption, columns, plot, legend_title=legend)


def _with_unit(frequency_hz: float) -> str:
    return EngFormatter("Hz")(float(f"{frequency_hz:.2g}"))
