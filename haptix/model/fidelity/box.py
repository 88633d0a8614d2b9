"""The box of boundary elements that represents a finger, and the part of its roughness in it."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property
from math import pi, sqrt
from typing import Any

import torch
from torch import Tensor

from haptix.base import checks
from haptix.base.errors import InputError
from haptix.model.contact.boundary_elements import ResolutionWarning, Surfaces
from haptix.model.contact.roughness import RoughnessSpectrum
from haptix.model.finger import Finger, MeasuredRoughness

_PIXELS = 4.0  # per shortest wavelength: the corrected area is then off by up to 4 %
_ALL = 0.98  # share of h_rms and of the slope below which a box warns


@dataclass(frozen=True)
class BoundaryElementBox:
    """Periodic random surfaces on which a finger's contact is solved point by point.

    Parameters
    ----------
    points : int
        Pixels along a side.
    surfaces : int
        Number of surfaces. The result is their mean; 2 or more also give its scatter.
    seed : int
        Seed of the surfaces' phases.
    waves : float
        Roll-off wavelengths along a side, where `side_m` is not given.
    side_m : float, optional
        Side of the box [m].
    q_high_per_m : float, optional
        Highest wavenumber kept [1/m]; by default the lower of the finger's highest and that of 4
        pixels per wavelength.
    tolerance : float
        Tolerance of the contact conditions, over h_rms.
    most_states : int
        Largest number of states in one call: each takes seconds.
    """

    points: int = 128
    surfaces: int = 4
    seed: int = 0
    waves: float = 2.0
    side_m: float | None = None
    q_high_per_m: float | None = None
    tolerance: float = 1e-5
    most_states: int = 64

    def __post_init__(self) -> None:
        for name in ("waves", "side_m", "q_high_per_m"):
            if getattr(self, name) is not None:
                checks.positive(name, getattr(self, name))
        for name in ("points", "surfaces", "most_states"):
            checks.whole(name, getattr(self, name), 1)


@dataclass(frozen=True)
class BoxedFinger:
    """The part of a finger's roughness that a box holds."""

    finger: Finger
    """The finger, with its whole band; no field may require grad."""
    box: BoundaryElementBox
    """Grid and band of the surfaces that are drawn."""

    def __post_init__(self) -> None:
        values = [value for part in (self.finger, self.finger.roughness) for _, value in part]
        if any(isinstance(value, Tensor) and value.requires_grad for value in values):
            raise InputError(
                "finger: expected values that need no gradient: boundary elements have none, got a "
                'tensor that requires grad; detach it, or use fidelity "mean-field"'
            )

    @cached_property
    def side_m(self) -> float:
        """Side of the box [m]."""
        if self.box.side_m is not None:
            return self.box.side_m
        return 2 * pi * self.box.waves / self._whole.q_rolloff

    @property
    def q_high_per_m(self) -> float:
        """Highest wavenumber held [1/m]."""
        sampled = 2 * pi * self.box.points / (_PIXELS * self.side_m)
        return min(self.box.q_high_per_m or sampled, self._whole.q1)

    @cached_property
    def surfaces(self) -> Surfaces:
        """The height maps; warns if the box leaves out roughness or is too coarse."""
        box, whole = self.box, self._whole
        with warnings.catch_warnings(record=True) as coarse:
            warnings.simplefilter("always", ResolutionWarning)
            drawn = Surfaces.random(
                whole, box.points, self.side_m, box.surfaces, box.seed, self.q_high_per_m
            )
        reasons = [str(warning.message) for warning in coarse]
        h_rms, slope = self._shares(drawn)
        if min(h_rms, slope) < _ALL:
            reasons.insert(
                0,
                f"the box holds the waves {drawn.q_low:.3g} to {drawn.q_high:.3g} /m of the "
                f"finger's {whole.q0:.3g} to {whole.q1:.3g} /m, {h_rms:.0%} of its h_rms and "
                f"{slope:.0%} of its slope: a contact smoother than the finger's, with more area",
            )
        if reasons:
            warnings.warn("; ".join(reasons), ResolutionWarning, stacklevel=2)
        return drawn

    @cached_property
    def roughness(self) -> MeasuredRoughness:
        """The spectrum of the surfaces: the finger's, cut to the box.

        Each wavevector of a box stands for a square cell of side ``2 pi / side``. The box has no
        wave in the cell at 0, whose area is that of a disc of radius ``2 pi / side / sqrt(pi)``.
        """
        whole = self._whole
        low = max(whole.q0, 2 * pi / (self.side_m * sqrt(pi)))
        high = self.q_high_per_m
        if not low < high:
            raise InputError(
                f"points: expected enough to hold waves shorter than {low:g} /m, got "
                f"{self.box.points}, which sample {high:g} /m; take more points or a smaller box"
            )
        inside = whole.wavenumber[(whole.wavenumber > low) & (whole.wavenumber < high)]
        q = torch.cat([inside.new_tensor([low]), inside, inside.new_tensor([high])])
        cut = RoughnessSpectrum(q, whole(q).detach())
        return MeasuredRoughness.of(cut, f"roughness of {self.finger.name!r}, cut to a box")

    @cached_property
    def gap_step_m(self) -> float:
        """Resolution in gaps [m]: the gap's change from pixel to pixel, by the rms slope."""
        drawn = self.surfaces
        return float(drawn.slope_rms.mean()) * drawn.pixel_m

    def describe(self) -> dict[str, Any]:
        """Box, band, sampling and share of the finger's roughness, as plain values."""
        drawn = self.surfaces
        h_rms, slope = self._shares(drawn)
        return {
            "points": self.box.points,
            "surfaces": self.box.surfaces,
            "seed": self.box.seed,
            "side_m": self.side_m,
            "waves_in_box": drawn.waves_in_box,
            "q_low_per_m": drawn.q_low,
            "q_high_per_m": drawn.q_high,
            "pixels_per_shortest_wave": drawn.pixels_per_shortest_wave,
            "h_rms_share": h_rms,
            "slope_share": slope,
            "gap_step_m": self.gap_step_m,
            "tolerance": self.box.tolerance,
            "attraction": "local, eps0/4 V^2/|u + h0|^2 on every point; contact bears it in spots",
        }

    @cached_property
    def _whole(self) -> RoughnessSpectrum:
        return self.finger.roughness.spectrum()

    def _shares(self, drawn: Surfaces) -> tuple[float, float]:
        h_rms, slope = drawn.h_rms_m.mean(), drawn.slope_rms.mean()
        return float(h_rms / self._whole.h_rms_m), float(slope / self._whole.slope_rms)
