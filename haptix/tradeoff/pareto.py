"""What nothing else beats in every respect."""

from __future__ import annotations

from collections.abc import Sequence


def pareto_front(costs: Sequence[tuple[float, ...]]) -> list[bool]:
    """Say which are on the front: no other is as low in every cost and lower in one.

    Parameters
    ----------
    costs : sequence of tuples of one length
        Lower is better. Equals are on the front together.
    """
    return [not any(_beats(other, one) for other in costs) for one in costs]


def _beats(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return one != other and all(a <= b for a, b in zip(one, other, strict=True))
