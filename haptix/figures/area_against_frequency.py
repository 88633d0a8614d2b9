"""Contact area against the drive's frequency, with air gaps that leak (paper, Fig. 4)."""

from __future__ import annotations

from collections.abc import Mapping

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
from haptix.status import Status

FORCE_N, VOLTAGE_V = 0.5, 100.0
RESISTIVITIES_OHM_M = (None, 1e7, 1e6, 1e5)
_COLORS = (COLD_TO_HOT[0], COLD_TO_HOT[2], COLD_TO_HOT[3], COLD_TO_HOT[4])
_FREQUENCY_HZ = np.geomspace(1.0, 1e6, 361)


def area_against_frequency(finger: Finger | None = None) -> FigureData:
    """A_on/A_off against f from 1 Hz to 1 MHz at 0.5 N and 100 V, d1 = 1 um, eps1 = 8.

    Parameters
    ----------
    finger : Finger, optional
        What touches; the semi-wet finger without.
    """
    finger = finger or Finger.preset("semi-wet")
    frequency = torch.from_numpy(_FREQUENCY_HZ)
    columns = {"frequency_hz": _FREQUENCY_HZ}
    curves, marks, highest = [], [], []
    for resistivity, color in zip(RESISTIVITIES_OHM_M, _COLORS, strict=True):
        model = _model(finger, resistivity)
        on = model.solve(FORCE_N, VOLTAGE_V, frequency)
        off = model.solve(FORCE_N, 0.0, frequency)
        ratio = light_contact(on.area_fraction / off.area_fraction, on.status)
        name, label = "dry_gap", "no leakage"
        if resistivity is not None:
            power = f"{np.log10(resistivity):.0f}"
            name, label = f"leaky_gap_1e{power}_ohm_m", rf"$\mathrm{{10}}^{power}$ Ωm"
            top = int(np.nanargmax(ratio))
            marks.append(Mark(_FREQUENCY_HZ[top], ratio[top], "o", "maximum", color))
            highest.append(f"{ratio[top]:.3f} at {_with_unit(_FREQUENCY_HZ[top])}")
        columns[f"area_on_over_off_{name}"] = ratio
        columns[f"status_{name}"] = numbers(on.status)
        curves.append(Curve("frequency_hz", f"area_on_over_off_{name}", label, color))
    dry = columns["area_on_over_off_dry_gap"]
    caption = (
        "Real contact area with voltage over that without, against the frequency of the drive, at "
        f"F_N = {FORCE_N:g} N and V0 = {VOLTAGE_V:g} V; d1 = 1 µm, eps1 = 8, "
        f"d2 = {float(finger.layer_thickness_m) * 1e6:g} µm. Without leakage the ratio is largest "
        f"at low frequencies, {dry[0]:.3f} at {_FREQUENCY_HZ[0]:g} Hz, where the skin conducts. A "
        "gap of finite resistivity lets the charge across at low frequencies, and a maximum "
        f"appears: {sentence_list(highest)} for 1e7, 1e6 and 1e5 Ohm m. "
        f"{_sparks(columns)}{_table_ends(finger)}"
        f"{basis(_model(finger, None), also_on='leaky-gap for the gaps that leak')}"
    )
    return FigureData(
        name="fig4",
        title="Contact area against frequency",
        caption=caption,
        columns=columns,
        panels=(
            Panel(
                "frequency $f$ (Hz)",
                r"$A_\mathrm{on}/A_\mathrm{off}$",
                tuple(curves),
                tuple(marks),
                x_scale="log",
                x_range=(_FREQUENCY_HZ[0], _FREQUENCY_HZ[-1]),
                legend_title="resistivity of the gap",
            ),
        ),
    )


def _model(finger: Finger, gap_resistivity_ohm_m: float | None) -> ContactModel:
    screen = Screen(
        name="Fig. 4",
        insulator_thickness_m=1e-6,
        insulator_permittivity=8.0,
        gap_resistivity_ohm_m=gap_resistivity_ohm_m,
    )
    return ContactModel(finger, screen, terms={"breakdown": True})


def _sparks(columns: Mapping[str, Array]) -> str:
    """Say where the dry gap's field is beyond what it bears."""
    broken = np.flatnonzero(columns["status_dry_gap"] == Status.BREAKDOWN)
    if not len(broken):
        return ""
    return (
        f"Up to {_with_unit(_FREQUENCY_HZ[broken[-1]])} the field in the dry gap passes the "
        f"{NARROW_GAP_FIELD_V_PER_M / 1e6:g} V/µm that narrow gaps bear, and its curve holds "
        "without sparks. "
    )


def _table_ends(finger: Finger) -> str:
    """Say so where the skin's dielectric is drawn beyond its table."""
    low, high = finger.dielectric.frequency_hz[0], finger.dielectric.frequency_hz[-1]
    if low <= _FREQUENCY_HZ[0] and high >= _FREQUENCY_HZ[-1]:
        return ""
    return (
        f"The table of the skin's dielectric reaches from {_with_unit(low)} to {_with_unit(high)} "
        "and is held at its last values beyond; its nodes are the bends of the upper curve. "
    )


def _with_unit(frequency_hz: float) -> str:
    for size, unit in ((1e6, "MHz"), (1e3, "kHz")):
        if frequency_hz >= size:
            return f"{float(f'{frequency_hz / size:.2g}'):g} {unit}"
    return f"{float(f'{frequency_hz:.2g}'):g} Hz"
