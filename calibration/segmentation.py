"""Segments of full slip in a recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from calibration.parameters import Array
from haptix.errors import InputError

SETTLING_MM = 4.0
"""Distance after each start that is left out: a fingertip first rolls and slips in part."""
STOPPING_MM = 1.5
"""Distance before each stop that is left out."""

_SMOOTHING_S = 0.02
_MOVING = 0.5  # of the usual speed; slower counts as starting and stopping
_TOUCHING = 0.4  # of the usual normal force


@dataclass(frozen=True)
class Segment:
    """Samples ``start`` to ``stop`` (not included), sliding towards `direction` (+1 or -1)."""

    start: int
    stop: int
    direction: int

    @property
    def samples(self) -> slice:
        """Return the samples."""
        return slice(self.start, self.stop)


def sliding_speed(t_s: Array, x_mm: Array) -> Array:
    """Velocity [mm/s], signed, shape (samples,): slope of a straight line through 20 ms.

    In slowly sampled recordings the line goes through three samples.
    """
    step = float(np.median(np.diff(t_s)))
    if not step > 0:
        raise InputError("t_s: expected times that increase")
    half = min(max(1, round(_SMOOTHING_S / step / 2)), len(t_s) - 1)
    # From the mean, so that large times do not cost digits.
    t, x = (
        np.pad(values - values.mean(), half, mode="reflect", reflect_type="odd")
        for values in (t_s, x_mm)
    )

    def mean(values: Array) -> Array:
        return np.asarray(uniform_filter1d(values, 2 * half + 1))[half:-half]

    covariance = mean(t * x) - mean(t) * mean(x)
    variance = mean(t * t) - mean(t) ** 2
    return np.asarray(covariance / np.maximum(variance, 1e-30))


def position_at_speed(
    t_s: Array, normal_force_n: Array, tangential_force_n: Array, speed_mm_per_s: float
) -> Array:
    """Position [mm], shape (samples,), of a finger that slides at a known speed.

    It slides where it presses and the tangential force, without its untouched level, is above half
    of its usual size; towards the side to which that force points.
    """
    zero = float(np.percentile(normal_force_n, 5))
    usual = float(np.percentile(normal_force_n - zero, 75))
    pressed = normal_force_n - zero > _TOUCHING * usual
    if not pressed.any() or pressed.all():
        return np.zeros_like(t_s)
    step = float(np.median(np.diff(t_s)))
    width = max(1, round(_SMOOTHING_S / step)) if step > 0 else 1
    drag = uniform_filter1d(tangential_force_n - np.median(tangential_force_n[~pressed]), width)
    slides = pressed & (np.abs(drag) > 0.5 * np.percentile(np.abs(drag[pressed]), 75))
    velocity = np.where(slides, np.sign(drag) * speed_mm_per_s, 0.0)
    return np.concatenate([[0.0], np.cumsum(velocity[:-1] * np.diff(t_s))])


def full_slip(
    t_s: Array,
    x_mm: Array,
    normal_force_n: Array | None = None,
    settling_mm: float = SETTLING_MM,
    stopping_mm: float = STOPPING_MM,
) -> list[Segment]:
    """Find the parts in which the finger touches and the whole contact slides, in order of time.

    All arrays have shape (samples,). Without a normal force the finger is taken to touch
    throughout. `settling_mm` are left out after each start, `stopping_mm` before each stop.
    """
    speed = sliding_speed(t_s, x_mm)
    fast = np.abs(speed)
    if not np.ptp(x_mm) > 0:
        return []
    # The usual speed is the one at which most of the distance is covered.
    usual = float(np.sqrt((fast**3).sum() / max(fast.sum(), 1e-30)))
    good = fast > _MOVING * usual
    if normal_force_n is not None:
        usual_force = float(np.median(normal_force_n[good])) if good.any() else 0.0
        good &= normal_force_n > _TOUCHING * usual_force
    sign = np.where(good, np.sign(speed), 0).astype(int)
    edges = np.flatnonzero(np.diff(sign)) + 1
    segments = []
    for start, stop in zip([0, *edges], [*edges, len(sign)], strict=True):
        if sign[start] == 0:
            continue
        slid = np.abs(x_mm[start:stop] - x_mm[start])
        inside = start + np.flatnonzero((slid >= settling_mm) & (slid <= slid[-1] - stopping_mm))
        if len(inside) >= 8:
            segments.append(Segment(int(inside[0]), int(inside[-1]) + 1, int(sign[start])))
    return segments
