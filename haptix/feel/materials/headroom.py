"""Headroom: how much of the target friction a surface can give, as a map and as numbers."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from haptix.base import checks
from haptix.base.checks import Array
from haptix.base.display import Displayed
from haptix.base.errors import InputError, from_extra
from haptix.feel.materials.field import Feelable, as_mu
from haptix.feel.materials.texture import Texture
from haptix.feel.motion import Motion
from haptix.model.perception.thresholds import WEBER_FRACTION
from haptix.model.status import LIMITS, Status

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from haptix.model.surface import FrictionSurface

_ABOVE = (Status.ABOVE, *LIMITS)
_NAMES = ("reachable", "below: lower than without voltage", "above: more than the highest gives")
_COLORS = ("0.93", "tab:blue", "tab:red")
_DPI = 110


@dataclass(frozen=True)
class HeadroomMap(Displayed):
    """Target friction at each place, and the reachable range at one force."""

    x_mm: Array
    """Shape (columns,)."""
    y_mm: Array
    """Shape (rows,)."""
    target_mu: Array
    """Shape (rows, columns)."""
    status: npt.NDArray[np.int8]
    """Integers of `Status`, shape (rows, columns)."""
    normal_force_n: float
    lowest_mu: float
    """Friction without voltage."""
    highest_mu: float
    """Friction at the highest voltage."""

    @property
    def below(self) -> float:
        """Share of the places whose target is below the friction without voltage."""
        return float((self.status == Status.BELOW).mean())

    @property
    def above(self) -> float:
        """Share of the places whose target is above the friction at the highest voltage."""
        return float(np.isin(self.status, _ABOVE).mean())

    @property
    def within(self) -> float:
        """Share of the places whose target is reachable."""
        return float((self.status == Status.OK).mean())

    @property
    def shortfall_mu(self) -> Array:
        """Target minus the nearest reachable friction, shape (rows, columns)."""
        return self.target_mu - self._nearest_mu

    @property
    def worst_jnd(self) -> float:
        """Largest shortfall of either sign, in just-noticeable differences (JND)."""
        return float((np.abs(self.shortfall_mu) / (WEBER_FRACTION * self._nearest_mu)).max())

    @property
    def _nearest_mu(self) -> Array:
        return np.clip(self.target_mu, self.lowest_mu, self.highest_mu)

    def numbers(self) -> dict[str, float]:
        """Key results, as plain numbers."""
        return {
            "normal_force_n": self.normal_force_n,
            "lowest_mu": self.lowest_mu,
            "highest_mu": self.highest_mu,
            "least_target_mu": float(self.target_mu.min()),
            "most_target_mu": float(self.target_mu.max()),
            "within": self.within,
            "below": self.below,
            "above": self.above,
            "worst_shortfall_mu": float(np.abs(self.shortfall_mu).max()),
            "worst_jnd": self.worst_jnd,
        }

    def draw(self) -> Figure:
        """Draw the target friction, the places out of range, and the reachable range."""
        with from_extra("figures"):
            from matplotlib.colors import ListedColormap
            from matplotlib.figure import Figure
            from matplotlib.patches import Patch

        figure = Figure(figsize=(12, 4.6), layout="constrained")
        target, reach, counts = figure.subplots(1, 3, width_ratios=(1.25, 1.1, 0.9))
        ends = (self.x_mm[0], self.x_mm[-1], self.y_mm[-1], self.y_mm[0])
        picture = target.imshow(self.target_mu, extent=ends, cmap="viridis")
        figure.colorbar(picture, ax=target, shrink=0.75)
        target.set(xlabel="x on the screen (mm)", ylabel="y (mm)", title="target friction (mu)")
        kind = np.select([self.status == Status.BELOW, np.isin(self.status, _ABOVE)], [1, 2], 0)
        reach.imshow(
            kind, extent=ends, cmap=ListedColormap(_COLORS), vmin=0, vmax=2, interpolation="nearest"
        )
        reach.set(xlabel="x on the screen (mm)", title=f"{100 * self.within:.3g} % reachable")
        parts = (self.within, self.below, self.above)
        patches = [
            Patch(facecolor=color, edgecolor="0.6", label=f"{name} ({100 * part:.3g} %)")
            for color, name, part in zip(_COLORS, _NAMES, parts, strict=True)
        ]
        figure.legend(handles=patches, loc="outside lower center", ncols=3, frameon=False)
        low, high = self.lowest_mu, self.highest_mu
        counts.hist(self.target_mu.ravel(), bins=60, color="0.4", orientation="horizontal")
        counts.axhspan(low, high, color="tab:green", alpha=0.25, label="reachable")
        span = (min(low, self.target_mu.min()), max(high, self.target_mu.max()))
        room = 0.06 * (span[1] - span[0])
        counts.set(
            ylim=(span[0] - room, span[1] + room),
            xlabel="places",
            ylabel="mu",
            title=f"reachable at {self.normal_force_n:g} N: {low:.3g} to {high:.3g}",
        )
        counts.legend(loc="best", fontsize=9)
        return figure

    def png(self) -> bytes:
        """PNG of the drawing."""
        file = io.BytesIO()
        self.draw().savefig(file, format="png", dpi=_DPI)
        return file.getvalue()


def headroom(
    field: Feelable,
    surface: FrictionSurface,
    normal_force_n: float,
    width_mm: float | None = None,
    height_mm: float | None = None,
    columns: int = 300,
    footprint_mm: float = 0.0,
) -> HeadroomMap:
    """Compare the targets of a field with the reachable range, on a grid from the origin.

    Parameters
    ----------
    field : FrictionField, Material or Layout
        Gives the target friction, of a finger at rest at 0 s.
    surface : FrictionSurface
        Sliced to one frequency and thickness: ``surface.at(frequency, h0)``. A drive may end below
        its highest voltage, at 185 V of 200 V for a carrier of 4 kHz: ``surface.limited(highest)``
        counts to there, where `highest` is `Renderer.highest_v`.
    normal_force_n : float
        The finger's force [N].
    width_mm, height_mm : float, optional
        Part of the screen; a texture has its own size.
    columns : int
        Places along the width; as dense down the height.
    footprint_mm : float
        Distance that the finger moves during one sample of the envelope, as in
        `FrictionField.friction`. A fast finger asks for less detail, 0 for all of it.

    Raises
    ------
    InputError
        If the size is missing or a value is outside its range.
    RangeError
        If the force lies outside the surface.

    Examples
    --------
    >>> import haptix
    >>> model = haptix.ContactModel(haptix.Finger(), haptix.Screen(), fidelity="closed-form")
    >>> surface = haptix.FrictionSurface.build(model, {"frequency_hz": 240.0}, 0.01)
    >>> ribs = haptix.feel.Grating(period_mm=2.0)
    >>> found = headroom(ribs, surface, normal_force_n=0.5, width_mm=10.0, height_mm=10.0)
    >>> found.lowest_mu < found.highest_mu
    True
    """
    if width_mm is None or height_mm is None:
        if not isinstance(field, Texture):
            raise InputError("width_mm, height_mm: expected a size, since the field has none")
        width_mm, height_mm = width_mm or field.width_mm, height_mm or field.height_mm
    checks.positive("width_mm", width_mm)
    checks.positive("height_mm", height_mm)
    checks.positive("columns", columns)
    step = width_mm / columns
    x = np.asarray((np.arange(columns) + 0.5) * step, dtype=np.float64)
    y = np.asarray((np.arange(max(1, round(height_mm / step))) + 0.5) * step, dtype=np.float64)
    column = surface.column(normal_force_n, None)
    low, high = float(column.lowest_mu), float(column.highest_mu)
    evaluator = field.evaluator
    motion = Motion.of(
        x[None, :],
        y[:, None],
        normal_force_n=normal_force_n,
        footprint_mm=footprint_mm,
        reachable=lambda force_n, _: (np.full_like(force_n, low), np.full_like(force_n, high)),
    )
    values = evaluator.wanted(motion).reshape(len(y), len(x))
    target = np.asarray(as_mu(evaluator.target, values, low, high))
    _, status = column.voltage(target)
    return HeadroomMap(x, y, target, status, float(normal_force_n), low, high)
