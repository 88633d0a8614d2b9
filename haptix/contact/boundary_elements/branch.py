"""The lowest branch of a contact under attraction, followed by its mean value.

Where the attraction grows faster than the contact resists, the strength (the squared voltage) does
not determine a state, but the mean attraction p_a does. So the branch is followed along p_a. Each
step computes the strength that sustains p_a, and the requested strengths are found on the way. The
contact snaps in where the strength stops rising with p_a.
"""

from __future__ import annotations

from collections.abc import Callable
from math import exp, log
from typing import NamedTuple

_LARGEST_STEP = 0.5
# Relative; near the end of the branch the area changes four times as much.
_STRENGTH_TOLERANCE = 3e-4
_SNAP_TOLERANCE = 0.02  # of the strength: half of it of the voltage
_MOST_STEPS = 30


class SnapIn(NamedTuple):
    """Strengths between which the lowest branch ends; higher ones are not reached."""

    low: float
    high: float


Point = tuple[float, float]  # logarithms of a mean attraction and of its strength
Measure = Callable[[float], Point]  # solves at the logarithm of a mean attraction


def lowest_branch(
    strengths: list[float],
    first_pa: float,
    strength_at: Callable[[float], float],
    reached: Callable[[float], None],
) -> SnapIn | None:
    """Walk up the branch; return where the contact snaps in before the last strength, or None.

    Parameters
    ----------
    strengths : list of float
        Strengths to find, above 0 and rising.
    first_pa : float
        Mean attraction on the branch to start with [Pa]. That of the first strength with the gaps
        held open is a lower bound, but may lie beyond the end.
    strength_at : callable
        Solves at a mean attraction [Pa], and returns the strength that sustains it.
    reached : callable
        Called with each strength in turn, when the state last solved is that of this strength.
    """

    def measure(at: float) -> Point:
        return at, log(strength_at(exp(at)))

    last = measure(log(first_pa))
    before: Point | None = None
    top, left, right = last, before, last  # the highest strength so far, and its neighbours
    for strength in strengths:
        target = log(strength)
        while last[1] < target - _STRENGTH_TOLERANCE:
            new = measure(last[0] + _step(before, last, target))
            if new[1] < top[1] - _SNAP_TOLERANCE:
                found = _summit(left, top, right if top != last else new, target, measure)
                if isinstance(found, SnapIn):
                    return found
                new = found
            if new[1] >= target:
                last, before = _between(top, new, target, measure)
            else:
                last, before = new, last
            # A shallow dip is a row of pixels that close one by one: continue past it.
            if last[1] > top[1]:
                top, left = last, before
            elif top == before:
                right = last
        reached(strength)
    return None


def _step(before: Point | None, last: Point, target: float) -> float:
    """Step in the attraction's logarithm by the slope so far, a little beyond the target."""
    slope = 1.0 if before is None else (last[1] - before[1]) / (last[0] - before[0])
    slope = min(max(slope, 0.05), 1.0)
    # Towards the end of the branch the slope falls: shorter steps do not overshoot it.
    return min(1.02 * (target - last[1]) / slope, _LARGEST_STEP * max(slope, 0.2))


def _between(low: Point, high: Point, target: float, measure: Measure) -> tuple[Point, Point]:
    """Regula falsi (Illinois) between a point below the target strength and one not below it.

    Returns the point found and one on its left.
    """
    if high[1] - target <= _STRENGTH_TOLERANCE:
        return high, low
    below, above = low[1] - target, high[1] - target
    left, right = low[0], high[0]
    found = high
    for _ in range(_MOST_STEPS):
        at = (left * above - right * below) / (above - below)
        found = measure(at)
        miss = found[1] - target
        if abs(miss) <= _STRENGTH_TOLERANCE:
            break
        if miss < 0:
            left, below, above = at, miss, above / 2
        else:
            right, above, below = at, miss, below / 2
    return found, low


def _summit(
    before: Point | None, top: Point, after: Point, target: float, measure: Measure
) -> Point | SnapIn:
    """Narrow down the highest strength between three points, or find one that is high enough.

    A strength rises no steeper than its attraction: between two points it is at most that much
    higher.
    """
    left = (top[0] - _LARGEST_STEP, top[1] - _LARGEST_STEP) if before is None else before
    right = after
    bound = top[1]
    for _ in range(_MOST_STEPS):
        bound = max(left[1] + top[0] - left[0], top[1] + right[0] - top[0])
        if bound - top[1] <= _SNAP_TOLERANCE:
            break
        at = top[0] + (right[0] - left[0]) * _lean(left, top, right)
        new = measure(at)
        if new[1] >= target:
            return new
        if new[1] > top[1]:
            left, top, right = (top, new, right) if at > top[0] else (left, new, top)
        elif at > top[0]:
            right = new
        else:
            left = new
    measure(top[0])  # leaves the last state of the branch
    return SnapIn(exp(top[1]), exp(bound))


def _lean(left: Point, top: Point, right: Point) -> float:
    """Where to look next, from the top as a share of the bracket: into its longer part."""
    longer = right[0] - top[0], top[0] - left[0]
    width = right[0] - left[0]
    return 0.5 * longer[0] / width if longer[0] >= longer[1] else -0.5 * longer[1] / width
