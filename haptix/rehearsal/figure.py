"""A rehearsal's picture: what was wanted and felt, and what the error is made of."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from haptix.perception import WEBER_FRACTION
from haptix.rehearsal.rehearse import Rehearsal
from haptix.texture import FrictionField

_PIXELS = 300  # across the map


def draw(file: Path, rehearsal: Rehearsal, texture: FrictionField) -> None:
    """Draw the path on the texture, friction and voltage against time, and the parts of the error.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    felt, wanted = rehearsal.felt, rehearsal.wanted_mu
    figure = Figure(figsize=(12, 8), layout="constrained")
    grid = figure.add_gridspec(3, 2, width_ratios=(1, 1.7), height_ratios=(1.3, 1, 1))

    place = figure.add_subplot(grid[:2, 0])
    margin = 2.0
    left, right = float(felt.x_mm.min()) - margin, float(felt.x_mm.max()) + margin
    top, bottom = float(felt.y_mm.min()) - margin, float(felt.y_mm.max()) + margin
    x, y = np.meshgrid(np.linspace(left, right, _PIXELS), np.linspace(top, bottom, _PIXELS))
    pixel_mm = (right - left) / _PIXELS
    level = texture.friction(x.ravel(), y.ravel(), pixel_mm).reshape(x.shape)
    shown = place.imshow(level, cmap="gray", extent=(left, right, bottom, top), aspect="equal")
    figure.colorbar(shown, ax=place, label=f"wanted ({texture.target})", shrink=0.7)
    place.plot(felt.x_mm, felt.y_mm, color="tab:red", lw=1)
    place.plot(felt.x_mm[0], felt.y_mm[0], "o", color="tab:red")
    place.set(xlabel="x (mm)", ylabel="y (mm)", title="1  Texture, and the finger's true path")

    parts = figure.add_subplot(grid[2, 0])
    errors = {**rehearsal.parts, "all": rehearsal.verdict}
    p95 = [one.error_p95_thresholds for one in errors.values()]
    colours = ["tab:blue"] * len(rehearsal.parts) + ["0.4"]
    parts.barh(list(errors), np.nan_to_num(p95), color=colours)
    parts.axvline(1.0, color="0.5", ls=":", lw=1)
    parts.invert_yaxis()
    parts.set(
        xscale="log",
        xlim=(1e-4, 10.0),
        xlabel="95 % of errors below (difference thresholds; 1 is felt)",
        title="4  What the error is made of",
    )

    friction = figure.add_subplot(grid[0, 1])
    t = felt.t_s
    band = WEBER_FRACTION * wanted
    friction.fill_between(
        t, wanted - band, wanted + band, color="tab:orange", alpha=0.2, lw=0,
        label="within one difference threshold",
    )  # fmt: skip
    friction.plot(t, wanted, color="tab:orange", lw=2.5, label="wanted under the true finger")
    friction.plot(t, felt.mu, color="tab:blue", lw=0.8, label="felt")
    friction.set(ylabel="friction coefficient", title="2  Friction")
    friction.margins(y=0.35)
    friction.legend(loc="upper right", fontsize=8, ncols=3)

    voltage = figure.add_subplot(grid[1, 1], sharex=friction)
    played = rehearsal.start_s + np.arange(len(rehearsal.played_v)) / rehearsal.sample_rate_hz
    voltage.plot(played, rehearsal.played_v, color="tab:purple", lw=0.3)
    voltage.set(ylabel="played (V)", title="3  Voltage")

    speed = figure.add_subplot(grid[2, 1], sharex=friction)
    speed.plot(t, felt.speed_mm_per_s, color="0.4")
    speed.set(ylabel="speed (mm/s)", xlabel="time (s)", xlim=(t[0], t[-1]))
    speed.set_ylim(0, None)
    force = speed.twinx()
    force.plot(t, felt.normal_force_n, color="tab:green", ls="--")
    force.set_ylabel("normal force (N), dashed", color="tab:green")
    force.set_ylim(0, None)
    figure.savefig(file, dpi=110)
