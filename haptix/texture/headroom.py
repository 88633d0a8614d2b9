"""Headroom: how much of the wanted friction a surface can give, as a map and as numbers."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from haptix.errors import InputError, check_positive
from haptix.perception import WEBER_FRACTION
from haptix.status import Status
from haptix.texture.field import Array, FrictionField, as_mu
from haptix.texture.texture import Texture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from haptix.surface import FrictionSurface

_ABOVE = (Status.ABOVE, Status.PULL_IN, Status.BREAKDOWN)
_NAMES = ("within reach", "below: lower than without voltage", "above: more than the highest gives")
_COLORS = ("0.93", "tab:blue", "tab:red")
_DPI = 110


@dataclass(frozen=True)
class Headroom:
    """What is wanted at each place, and what can be reached at one force."""

    x_mm: Array
    """Shape (columns,)."""
    y_mm: Array
    """Shape (rows,)."""
    wanted_mu: Array
    """Shape (rows, columns)."""
    status: npt.NDArray[np.int64]
    """Integers of `Status`, shape (rows, columns)."""
    normal_force_n: float
    lowest_mu: float
    """Without voltage."""
    highest_mu: float
    """At the highest voltage."""

    @property
    def below(self) -> float:
        """Part of the places that want less friction than there is without voltage."""
        return float((self.status == Status.BELOW).mean())

    @property
    def above(self) -> float:
        """Part of the places that want more than the highest voltage gives."""
        return float(np.isin(self.status, _ABOVE).mean())

    @property
    def within(self) -> float:
        """Part of the places that can be reached."""
        return float((self.status == Status.OK).mean())

    @property
    def shortfall_mu(self) -> Array:
        """Wanted less reached, above 0 where too much is wanted, shape (rows, columns)."""
        return self.wanted_mu - np.clip(self.wanted_mu, self.lowest_mu, self.highest_mu)

    @property
    def worst_thresholds(self) -> float:
        """Largest shortfall of either sign, in difference thresholds of what is reached there."""
        reached = np.clip(self.wanted_mu, self.lowest_mu, self.highest_mu)
        return float((np.abs(self.shortfall_mu) / (WEBER_FRACTION * reached)).max())

    def numbers(self) -> dict[str, float]:
        """The figures that the drawing shows, as plain numbers."""
        return {
            "normal_force_n": self.normal_force_n,
            "lowest_mu": self.lowest_mu,
            "highest_mu": self.highest_mu,
            "least_wanted_mu": float(self.wanted_mu.min()),
            "most_wanted_mu": float(self.wanted_mu.max()),
            "within": self.within,
            "below": self.below,
            "above": self.above,
            "worst_shortfall_mu": float(np.abs(self.shortfall_mu).max()),
            "worst_thresholds": self.worst_thresholds,
        }

    def draw(self) -> Figure:
        """Map of what is out of reach, and the wanted friction beside the reachable range."""
        from matplotlib.colors import ListedColormap
        from matplotlib.figure import Figure
        from matplotlib.patches import Patch

        figure = Figure(figsize=(12, 4.6), layout="constrained")
        wanted, reach, counts = figure.subplots(1, 3, width_ratios=(1.25, 1.1, 0.9))
        ends = (self.x_mm[0], self.x_mm[-1], self.y_mm[-1], self.y_mm[0])
        picture = wanted.imshow(self.wanted_mu, extent=ends, cmap="viridis")
        figure.colorbar(picture, ax=wanted, shrink=0.75)
        wanted.set(xlabel="x on the screen (mm)", ylabel="y (mm)", title="friction wanted (mu)")
        kind = np.select([self.status == Status.BELOW, np.isin(self.status, _ABOVE)], [1, 2], 0)
        reach.imshow(
            kind, extent=ends, cmap=ListedColormap(_COLORS), vmin=0, vmax=2, interpolation="nearest"
        )
        reach.set(xlabel="x on the screen (mm)", title=f"{100 * self.within:.3g} % within reach")
        parts = (self.within, self.below, self.above)
        patches = [
            Patch(facecolor=color, edgecolor="0.6", label=f"{name} ({100 * part:.3g} %)")
            for color, name, part in zip(_COLORS, _NAMES, parts, strict=True)
        ]
        figure.legend(handles=patches, loc="outside lower center", ncols=3, frameon=False)
        low, high = self.lowest_mu, self.highest_mu
        counts.hist(self.wanted_mu.ravel(), bins=60, color="0.4", orientation="horizontal")
        counts.axhspan(low, high, color="tab:green", alpha=0.25, label="reachable")
        span = (min(low, self.wanted_mu.min()), max(high, self.wanted_mu.max()))
        room = 0.06 * (span[1] - span[0])
        counts.set(
            ylim=(span[0] - room, span[1] + room),
            xlabel="places",
            ylabel="mu",
            title=f"reach at {self.normal_force_n:g} N: {low:.3g} to {high:.3g}",
        )
        counts.legend(loc="best", fontsize=9)
        return figure

    def png(self) -> bytes:
        """PNG of the drawing."""
        file = io.BytesIO()
        self.draw().savefig(file, format="png", dpi=_DPI)
        return file.getvalue()


def headroom(
    field: FrictionField,
    surface: FrictionSurface,
    normal_force_n: float,
    width_mm: float | None = None,
    height_mm: float | None = None,
    columns: int = 300,
    footprint_mm: float = 0.0,
) -> Headroom:
    """Ask on a grid of places from the origin how much of a field can be reached.

    Parameters
    ----------
    field : FrictionField
        What is wanted.
    surface : FrictionSurface
        What can be given, sliced to one frequency and thickness: ``surface.at(frequency, h0)``.
    normal_force_n : float
        The finger's force [N].
    width_mm, height_mm : float, optional
        Part of the screen to ask; a texture has its own size.
    columns : int
        Places along the width; as dense down the height.
    footprint_mm : float
        Way of the finger during one sample of the envelope, as in `FrictionField.friction`; a fast
        finger asks for less. 0 asks for all detail.

    Raises
    ------
    InputError
        If the size is missing or a value is outside its range.
    RangeError
        If the force lies outside the surface.
    """
    if width_mm is None or height_mm is None:
        if not isinstance(field, Texture):
            raise InputError("width_mm, height_mm: expected a size, since the field has none")
        width_mm, height_mm = width_mm or field.width_mm, height_mm or field.height_mm
    check_positive("width_mm", width_mm)
    check_positive("height_mm", height_mm)
    check_positive("columns", columns)
    step = width_mm / columns
    x = np.asarray((np.arange(columns) + 0.5) * step, dtype=np.float64)
    y = np.asarray((np.arange(max(1, round(height_mm / step))) + 0.5) * step, dtype=np.float64)
    surface.mu(normal_force_n, 0.0)  # which refuses a force outside the surface, by name
    low, high = (float(end) for end in surface.reachable(normal_force_n))
    values = field.friction(x[None, :], y[:, None], footprint_mm)
    wanted = np.asarray(as_mu(field.target, values, low, high))
    # The two ends themselves are within reach, whatever the last digit of the arithmetic says.
    hair = 1e-9 * (high - low)
    inner = np.where(np.abs(wanted - low) < hair, low + hair, wanted)
    inner = np.where(np.abs(wanted - high) < hair, high - hair, inner)
    status = surface.voltage(inner.ravel(), normal_force_n).status.numpy().reshape(wanted.shape)
    return Headroom(x, y, wanted, status.astype(np.int64), float(normal_force_n), low, high)
