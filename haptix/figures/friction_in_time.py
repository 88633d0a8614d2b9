"""Friction against time under a sine (paper, Fig. 3B): ripples at twice the drive's frequency."""

from __future__ import annotations

import numpy as np

from haptix.electro.breakdown import NARROW_GAP_FIELD_V_PER_M
from haptix.figures.data import COLD_TO_HOT, Curve, FigureData, Panel, basis, light_contact, numbers
from haptix.finger import Finger
from haptix.friction import ContactModel
from haptix.screen import Screen
from haptix.status import Status

FORCE_N, VOLTAGE_V, FREQUENCY_HZ = 1.0, 200.0, 125.0
SHOWN_S = 0.04
_SAMPLES = 256  # in a period; the ripple is smooth


def friction_in_time(finger: Finger | None = None, screen: Screen | None = None) -> FigureData:
    """Friction force at 1 N, under 200 V at 125 Hz and without voltage, over 40 ms.

    Parameters
    ----------
    finger, screen : Finger, Screen, optional
        What touches what; the semi-wet finger on the paper's screen without.
    """
    model = ContactModel(finger or Finger.preset("semi-wet"), screen or Screen.preset("3m-sct3250"))
    period = model.over_period(
        normal_force_n=FORCE_N,
        voltage_v=VOLTAGE_V,
        frequency_hz=FREQUENCY_HZ,
        samples=_SAMPLES,
    )
    periods = round(SHOWN_S * FREQUENCY_HZ)
    time = np.arange(periods * _SAMPLES) / (_SAMPLES * FREQUENCY_HZ)
    with_voltage = np.tile(FORCE_N * light_contact(period.mu, period.status), periods)
    off = model.solve(FORCE_N, 0.0, FREQUENCY_HZ)
    averaged = model.solve(FORCE_N, VOLTAGE_V, FREQUENCY_HZ)
    field = float(averaged.peak_field_v_per_m) / 1e6
    columns = {
        "time_ms": time * 1e3,
        "drive_v": np.tile(numbers(period.drive_v), periods),
        "attraction_pa": np.tile(light_contact(period.attraction_pa, period.status), periods),
        "friction_200v_n": with_voltage,
        "friction_0v_n": np.full_like(time, FORCE_N * float(off.mu)),
        "status_200v": np.tile(numbers(period.status), periods),
    }
    past = bool((period.status == int(Status.PULL_IN)).any())
    caption = (
        f"Friction force at a normal force of {FORCE_N:g} N, with {VOLTAGE_V:g} V at "
        f"{FREQUENCY_HZ:g} Hz on the screen and with the voltage off. The attraction goes with the "
        f"square of the voltage, so that friction ripples at {2 * FREQUENCY_HZ:g} Hz: from "
        f"{np.nanmin(with_voltage):.3f} to {np.nanmax(with_voltage):.3f} N, mean "
        f"{np.nanmean(with_voltage):.3f} N; without voltage {FORCE_N * float(off.mu):.3f} N. The "
        "contact follows the attraction without delay, and the skin's inertia and viscosity are "
        "left out; in equilibrium with the time-averaged attraction it is "
        f"{FORCE_N * float(averaged.mu):.3f} N. "
        f"The field at the edges of contact spots peaks at {field:.0f} V/µm; narrow gaps bear some "
        f"{NARROW_GAP_FIELD_V_PER_M / 1e6:g} V/µm, and the curve holds without sparks. "
        + ("Where the curve has gaps the contact snaps in. " if past else "")
        + basis(model)
    )
    return FigureData(
        name="fig3b",
        title="Friction against time under a sine",
        caption=caption,
        columns=columns,
        panels=(
            Panel(
                "time (ms)",
                "voltage (V)",
                (Curve("time_ms", "drive_v", color="0.35", width=1.4),),
                x_range=(0, SHOWN_S * 1e3),
                has_legend=False,
            ),
            Panel(
                "time (ms)",
                r"friction force $F_\mathrm{f}$ (N)",
                (
                    Curve("time_ms", "friction_200v_n", "200 V, 125 Hz", COLD_TO_HOT[2]),
                    Curve("time_ms", "friction_0v_n", "voltage off", COLD_TO_HOT[0]),
                ),
                x_range=(0, SHOWN_S * 1e3),
                y_range=(0, 1.1 * float(np.nanmax(with_voltage))),
            ),
        ),
        stacked=True,
    )
