"""The demo's one picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from haptix.motion import Trajectory
from haptix.texture import Texture

if TYPE_CHECKING:
    from haptix.demo.judge import Outcome

Array = npt.NDArray[np.float64]

_ZOOM_S = 0.006


def draw(
    file: Path,
    texture: Texture,
    path: Trajectory,
    outcome: Outcome,
    played_v: Array,
    sample_rate_hz: float,
    voltage_limit_v: float,
    bright_is_high: bool,
) -> None:
    """Photograph with the path, friction, voltage, and a zoom of the wave that went out."""
    figure = Figure(figsize=(13, 8.5), layout="constrained")
    grid = figure.add_gridspec(3, 2, width_ratios=(1, 1.5), height_ratios=(1.15, 1, 1))
    _photograph(figure.add_subplot(grid[:2, 0]), texture, path, bright_is_high)
    _force_and_speed(figure.add_subplot(grid[2, 0]), path)
    friction = figure.add_subplot(grid[0, 1])
    _friction(friction, outcome)
    voltage = figure.add_subplot(grid[1, 1], sharex=friction)
    _voltage(voltage, outcome, voltage_limit_v)
    period = float(np.median(np.diff(outcome.t_s)))
    count = min(round(max(_ZOOM_S, 10 * period) * sample_rate_hz), len(played_v))
    first = _liveliest(played_v, count)
    zoom = np.arange(first, first + count)
    t = zoom / sample_rate_hz
    voltage.axvspan(t[0] - 0.01, t[-1] + 0.01, color="tab:purple", alpha=0.5)
    voltage.annotate(
        "5",
        (t[0], 0.92 * voltage_limit_v),
        (5, 0),
        textcoords="offset points",
        color="tab:purple",
        fontweight="bold",
    )
    wave = figure.add_subplot(grid[2, 1])
    wave.plot(t * 1e3, played_v[zoom], color="tab:purple", lw=1, marker=".", ms=3)
    wave.set(
        xlabel="time (ms)",
        ylabel="drive (V)",
        title="5  The wave that was played, sample by sample: the purple band of 4",
    )
    figure.suptitle("haptix: from a photograph to volts", fontsize=14)
    figure.savefig(file, dpi=110)


def _photograph(axes: Axes, texture: Texture, path: Trajectory, bright_is_high: bool) -> None:
    axes.imshow(
        texture.level,
        cmap="gray" if bright_is_high else "gray_r",
        extent=(0, texture.width_mm, texture.height_mm, 0),
    )
    points = axes.scatter(path.x_mm, path.y_mm, c=path.t_s - path.t_s[0], s=10, cmap="autumn")
    axes.plot(path.x_mm[0], path.y_mm[0], "o", ms=11, mfc="none", mec="tab:blue", mew=2.5)
    axes.annotate(
        "start",
        (path.x_mm[0], path.y_mm[0]),
        (-6, 12),
        textcoords="offset points",
        color="white",
        fontweight="bold",
        bbox={"facecolor": "tab:blue", "edgecolor": "none", "pad": 1.5},
    )
    axes.figure.colorbar(points, ax=axes, label="time (s)", shrink=0.7)
    grey = "bright" if bright_is_high else "dark"
    axes.set(
        xlabel="x on the screen (mm)",
        ylabel="y (mm)",
        title=f"1  Photograph ({grey} = high friction)\nand path of the finger, from red to yellow",
    )


def _force_and_speed(axes: Axes, path: Trajectory) -> None:
    speed = np.hypot(np.gradient(path.x_mm, path.t_s), np.gradient(path.y_mm, path.t_s))
    t = path.t_s - path.t_s[0]
    axes.plot(t, path.normal_force_n, color="tab:green")
    axes.set_ylabel("normal force (N)", color="tab:green")
    axes.set(ylim=(0, None), xlabel="time (s)", title="2  The finger's force and speed")
    twin = axes.twinx()
    twin.plot(t, speed, color="0.4", ls="--")
    twin.set_ylabel("speed (mm/s), dashed", color="0.4")
    twin.set_ylim(0, None)


def _friction(axes: Axes, outcome: Outcome) -> None:
    t = outcome.t_s
    low, high = outcome.lowest_mu, outcome.highest_mu
    axes.fill_between(t, low, high, color="0.9", label="reachable at this force")
    axes.plot(t, outcome.target_mu, color="tab:orange", lw=3, label="wanted by the photograph")
    axes.plot(t, outcome.reached_mu, color="tab:blue", lw=0.8, label="reached by the wave played")
    room = 0.3 * (high.max() - low.min())
    axes.set(
        ylabel="friction coefficient",
        ylim=(low.min() - 0.05 * room, high.max() + room),
        title="3  Friction under the finger, which also depends on its force",
    )
    axes.legend(loc="upper center", ncols=3, fontsize=8, columnspacing=1.2)


def _voltage(axes: Axes, outcome: Outcome, voltage_limit_v: float) -> None:
    axes.plot(outcome.t_s, outcome.amplitude_v, color="tab:red", lw=0.8)
    axes.axhline(voltage_limit_v, color="0.5", ls=":", lw=1)
    axes.text(outcome.t_s[-1], voltage_limit_v, "limit of the screen", ha="right", va="bottom")
    axes.set(
        ylabel="amplitude (V)",
        ylim=(0, 1.15 * voltage_limit_v),
        xlabel="time (s)",
        title="4  Voltage that does it",
    )


def _liveliest(played_v: Array, count: int) -> int:
    """First sample of the window whose halves differ most in amplitude."""
    peaks = np.abs(played_v[: len(played_v) // count * count]).reshape(-1, count)
    half = count // 2
    change = np.abs(peaks[:, :half].max(1) - peaks[:, half:].max(1))
    return int(change.argmax()) * count
