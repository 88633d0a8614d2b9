"""The picture of a simulation."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from haptix.errors import from_extra
from haptix.motion import Motion
from haptix.simulation.simulation import Simulation
from haptix.texture import Texture

with from_extra("figures"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_DRAWN_MM_PER_S = 50.0  # what depends on the motion is drawn as felt on the way to the right
_PIXELS = 400  # across the texture
_MARGIN_MM = 2.0  # around the path, on a texture without edges
_ZOOM_S = 0.006
_ZOOM_PERIODS = 10


def draw(simulation: Simulation, file: Path) -> None:
    """Draw path and texture, friction, voltage, and the waveform or the parts of the error."""
    figure = Figure(figsize=(13, 8.5), layout="constrained")
    grid = figure.add_gridspec(3, 2, width_ratios=(1, 1.5), height_ratios=(1.15, 1, 1))
    _texture(figure.add_subplot(grid[:2, 0]), simulation)
    _force_and_speed(figure.add_subplot(grid[2, 0]), simulation)
    friction = figure.add_subplot(grid[0, 1])
    _friction(friction, simulation)
    voltage = figure.add_subplot(grid[1, 1], sharex=friction)
    _voltage(voltage, simulation)
    last = figure.add_subplot(grid[2, 1])
    if simulation.parts:
        _parts(last, simulation)
    else:
        _zoom(last, voltage, simulation)
    figure.suptitle("haptix: from a texture to volts", fontsize=14)
    figure.savefig(file, dpi=110, format="png")


def _texture(axes: Axes, simulation: Simulation) -> None:
    felt, texture = simulation.felt, simulation.setting.texture
    if isinstance(texture, Texture):
        left, right, top, bottom = 0.0, texture.width_mm, 0.0, texture.height_mm
    else:
        left, right = float(felt.x_mm.min()) - _MARGIN_MM, float(felt.x_mm.max()) + _MARGIN_MM
        top, bottom = float(felt.y_mm.min()) - _MARGIN_MM, float(felt.y_mm.max()) + _MARGIN_MM
    pixel_mm = (right - left) / _PIXELS
    rows = max(2, round((bottom - top) / pixel_mm))
    x, y = np.meshgrid(np.linspace(left, right, _PIXELS), np.linspace(top, bottom, rows))
    to_the_right = Motion.of(x, y, 0.0, _DRAWN_MM_PER_S, 0.0, footprint_mm=pixel_mm)
    target = texture.evaluator.wanted(to_the_right).reshape(x.shape)
    axes.imshow(target, cmap="gray", extent=(left, right, bottom, top))
    points = axes.scatter(felt.x_mm, felt.y_mm, c=felt.t_s - felt.t_s[0], s=4, cmap="autumn")
    start = (float(felt.x_mm[0]), float(felt.y_mm[0]))
    axes.plot(*start, "o", ms=11, mfc="none", mec="tab:blue", mew=2.5)
    axes.annotate(
        "start",
        start,
        (-6, 12),
        textcoords="offset points",
        color="white",
        fontweight="bold",
        bbox={"facecolor": "tab:blue", "edgecolor": "none", "pad": 1.5},
    )
    axes.figure.colorbar(points, ax=axes, label="time (s)", shrink=0.7)
    axes.set(
        xlabel="x on the screen (mm)",
        ylabel="y (mm)",
        title="1  Texture (bright = high friction)\nand path of the finger, from red to yellow",
    )


def _force_and_speed(axes: Axes, simulation: Simulation) -> None:
    felt = simulation.felt
    t = felt.t_s - felt.t_s[0]
    axes.plot(t, felt.normal_force_n, color="tab:green")
    axes.set_ylabel("normal force (N)", color="tab:green")
    axes.set(ylim=(0, None), xlabel="time (s)", title="2  The finger's force and speed")
    speed = axes.twinx()
    speed.plot(t, felt.speed_mm_per_s, color="0.4", ls="--")
    speed.set_ylabel("speed (mm/s), dashed", color="0.4")
    speed.set_ylim(0, None)


def _friction(axes: Axes, simulation: Simulation) -> None:
    t, target = simulation.felt.t_s, simulation.target_mu
    low, high = simulation.lowest_mu, simulation.highest_mu
    axes.fill_between(t, low, high, color="0.9", label="reachable at this force")
    axes.plot(t, target, color="tab:orange", lw=3, label="target")
    axes.plot(t, simulation.felt.mu, color="tab:blue", lw=0.8, label="felt")
    room = 0.3 * (high.max() - low.min())
    axes.set(
        ylabel="friction coefficient",
        ylim=(low.min() - 0.05 * room, high.max() + room),
        title="3  Friction under the finger, which also depends on its force",
    )
    axes.legend(loc="upper center", ncols=3, fontsize=8, columnspacing=1.2)


def _voltage(axes: Axes, simulation: Simulation) -> None:
    played, limit = simulation.played, simulation.surface.voltage_limit_v
    volts = played.drive_v
    t = played.start_s + np.arange(len(volts)) / played.renderer.sample_rate_hz
    axes.plot(t, volts, color="tab:purple", lw=0.3)
    axes.axhline(limit, color="0.5", ls=":", lw=1)
    axes.text(simulation.felt.t_s[-1], limit, "limit of the screen", ha="right", va="bottom")
    axes.set(
        ylabel="played (V)",
        ylim=(-1.15 * limit, 1.25 * limit),
        xlabel="time (s)",
        title="4  Voltage that was played",
    )


def _parts(axes: Axes, simulation: Simulation) -> None:
    errors = {**simulation.parts, "all": simulation.evaluation}
    p95 = np.nan_to_num([one.error_p95_jnd for one in errors.values()])
    axes.barh(list(errors), p95, color=["tab:blue"] * len(simulation.parts) + ["0.4"])
    axes.axvline(1.0, color="0.5", ls=":", lw=1)
    axes.invert_yaxis()
    axes.set(
        xscale="log",
        xlim=(1e-4, 10.0),
        xlabel="95 % of errors are below (JND)",
        title="5  What the error is made of",
    )


def _zoom(axes: Axes, voltage: Axes, simulation: Simulation) -> None:
    """Draw the liveliest stretch of the wave, and mark it in the voltage."""
    played = simulation.played
    volts, rate = played.drive_v, played.renderer.sample_rate_hz
    seconds = max(_ZOOM_S, _ZOOM_PERIODS / played.renderer.drive.frequency_hz)
    count = min(round(seconds * rate), len(volts))
    # The window whose halves differ most in amplitude.
    peaks = np.abs(volts[: len(volts) // count * count]).reshape(-1, count)
    change = np.abs(peaks[:, : count // 2].max(1) - peaks[:, count // 2 :].max(1))
    first = int(change.argmax()) * count
    t = played.start_s + np.arange(first, first + count) / rate
    voltage.axvspan(t[0] - 0.01, t[-1] + 0.01, color="tab:orange", alpha=0.5)
    top = 0.92 * simulation.surface.voltage_limit_v
    voltage.annotate("5", (t[0], top), (5, 0), textcoords="offset points", fontweight="bold")
    axes.plot(t * 1e3, volts[first : first + count], color="tab:purple", lw=1, marker=".", ms=3)
    axes.set(
        xlabel="time (ms)",
        ylabel="played (V)",
        title="5  The wave that was played, sample by sample: the band in 4",
    )
