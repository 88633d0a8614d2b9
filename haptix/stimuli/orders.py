"""Orders of conditions: Latin squares by participant, and random orders with constraints."""

from __future__ import annotations

import hashlib
from collections.abc import Hashable, Sequence
from typing import Literal, TypeVar, get_args

import numpy as np

from haptix.checks import choice, whole
from haptix.errors import InputError

Item = TypeVar("Item", bound=Hashable)
Design = Literal["as-listed", "random", "latin-square", "williams"]

_MOST_DRAWS = 1000


def latin_square(count: int) -> list[list[int]]:
    """Cyclic Latin square: each row and each column has every number once."""
    whole("count", count, 1)
    return [[(row + column) % count for column in range(count)] for row in range(count)]


def williams_square(count: int) -> list[list[int]]:
    """Latin square in which each number follows each other one equally often.

    Williams, Aust. J. Sci. Res. A 2, 149 (1949). With an odd count it has twice as many rows.
    """
    whole("count", count, 1)
    first, low, high = [0], 1, count - 1
    while low <= high:
        first.append(low)
        if low != high:
            first.append(high)
        low, high = low + 1, high - 1
    rows = [[(start + step) % count for step in first] for start in range(count)]
    return rows + [row[::-1] for row in rows] if count % 2 and count > 1 else rows


def order_for(
    items: Sequence[Item], participant: int, design: Design = "williams", seed: int = 0
) -> list[Item]:
    """Return the order of some conditions for a participant, counterbalanced by the number.

    Participants 1, 2, ... take the rows of the square in turn: groups as large as its number of
    rows are balanced. A random order depends on seed and participant.
    """
    whole("participant", participant, 0)
    choice("order", design, get_args(Design))
    if design == "as-listed":
        return list(items)
    if design == "random":
        draw = np.random.default_rng([seed, participant])
        return [items[int(i)] for i in draw.permutation(len(items))]
    make = latin_square if design == "latin-square" else williams_square
    square = make(len(items))
    return [items[i] for i in square[(participant - 1) % len(square)]]


def seed_of(seed: int, participant: str, session: str) -> int:
    """Return the seed of one session, so that no two have trials in the same order."""
    text = f"{seed}/{participant}/{session}"
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "big")


def constrained_order(
    items: Sequence[Item],
    repeats: int,
    seed: int = 0,
    most_in_a_row: int = 1,
) -> list[Item]:
    """Return a random order with each item `repeats` times, none more than some times in a row.

    Parameters
    ----------
    items : sequence
        Different items.
    repeats : int
        How often each comes.
    seed : int
        Seed of the order.
    most_in_a_row : int
        Longest run of one item.

    Raises
    ------
    InputError
        If there is no such order, or none was found.
    """
    whole("repeats", repeats, 1)
    whole("most_in_a_row", most_in_a_row, 1)
    draw = np.random.default_rng(seed)
    for _ in range(_MOST_DRAWS):
        left = dict.fromkeys(items, repeats)
        order: list[Item] = []
        while True:
            last = order[-most_in_a_row:]
            is_full = len(last) == most_in_a_row and len(set(last)) == 1
            open_ones = [one for one, n in left.items() if n and not (is_full and one == last[0])]
            if not open_ones:
                break
            weights = np.array([left[one] for one in open_ones], float)
            order.append(open_ones[int(draw.choice(len(open_ones), p=weights / weights.sum()))])
            left[order[-1]] -= 1
        if len(order) == repeats * len(items):
            return order
    raise InputError(
        f"order: found none of {len(items)} items, {repeats} times each, with at most "
        f"{most_in_a_row} in a row; allow longer runs"
    )
