"""Friction against time under a sine (paper, Fig. 3B): ripples at twice the drive's frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from haptix.figures import data
from haptix.finger import Finger
from haptix.friction import ContactModel
from haptix.screen import Screen

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FORCE_N, VOLTAGE_V, FREQUENCY_HZ = 1.0, 200.0, 125.0
SHOWN_S = 0.04
_SAMPLES = 256  # in a period; the ripple is smooth


def friction_in_time() -> data.FigureData:
    """Friction force at 1 N, under 200 V at 125 Hz and without voltage, over 40 ms."""
    finger, screen = Finger.preset("semi-wet"), Screen.preset("3m-sct3250")
    model = ContactModel(finger, screen, terms=data.AT_H0)
    period = model.over_period(FORCE_N, VOLTAGE_V, FREQUENCY_HZ, h0_m=data.H0_M, samples=_SAMPLES)
    periods = round(SHOWN_S * FREQUENCY_HZ)
    time = np.arange(periods * _SAMPLES) / (_SAMPLES * FREQUENCY_HZ)
    friction = np.tile(FORCE_N * data.light_contact(period.mu, period.status), periods)
    averaged = model.solve(FORCE_N, VOLTAGE_V, FREQUENCY_HZ, data.H0_M)
    off_n = FORCE_N * float(model.solve(FORCE_N, 0.0, FREQUENCY_HZ, data.H0_M).mu)
    columns = {
        "time_ms": time * 1e3,
        "drive_v": np.tile(data.numbers(period.drive_v), periods),
        "attraction_pa": np.tile(data.light_contact(period.attraction_pa, period.status), periods),
        "friction_200v_n": friction,
        "friction_0v_n": np.full_like(time, off_n),
        "status_200v": np.tile(data.numbers(period.status), periods),
    }

    def plot(above: Axes, below: Axes) -> None:
        above.plot(columns["time_ms"], columns["drive_v"], color="0.35", lw=1.4)
        above.set(ylabel="voltage (V)")
        for column, label, color in (
            ("friction_200v_n", "200 V, 125 Hz", data.COLD_TO_HOT[2]),
            ("friction_0v_n", "voltage off", data.COLD_TO_HOT[0]),
        ):
            below.plot(columns["time_ms"], columns[column], color=color, label=label)
        below.set(xlabel="time (ms)", xlim=(0, SHOWN_S * 1e3))
        below.set(ylabel=r"friction force $F_\mathrm{f}$ (N)", ylim=(0, 1.1 * friction.max()))

    caption = (
        f"Friction force at a normal force of {FORCE_N:g} N, with {VOLTAGE_V:g} V at "
        f"{FREQUENCY_HZ:g} Hz on the screen and with the voltage off; h0 = "
        f"{data.H0_M * 1e6:g} µm, as in Fig. 3C. Attraction depends on the "
        f"square of the voltage, so that friction ripples at {2 * FREQUENCY_HZ:g} Hz: from "
        f"{friction.min():.3f} to {friction.max():.3f} N, mean {friction.mean():.3f} N; without "
        f"voltage {off_n:.3f} N. The contact follows the attraction without delay, and the skin's "
        "inertia and viscosity are left out; in equilibrium with the time-averaged attraction it "
        f"is {FORCE_N * float(averaged.mu):.3f} N. The field at the edges of contact spots peaks "
        f"at {float(averaged.peak_field_v_per_m) / 1e6:.0f} V/µm, against {data.NARROW_GAPS_BEAR}; "
        f"the curve holds without sparks. {data.AS_QUERIED} {data.basis(model)}"
    )
    title = "Friction against time under a sine"
    return data.FigureData("fig3b", title, caption, columns, plot, grid=(2, 1))
