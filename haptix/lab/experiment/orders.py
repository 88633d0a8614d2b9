"""Orders of presentations: random, Latin squares, and squares that balance what follows what."""

from __future__ import annotations

import hashlib
from collections.abc import Hashable, Sequence
from typing import Literal, TypeVar, get_args

import numpy as np

from haptix.base.checks import choice, whole

Item = TypeVar("Item", bound=Hashable)

BlockOrder = Literal["as-listed", "random", "latin-square", "williams"]


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
    items: Sequence[Item], participant: int, design: BlockOrder = "williams", seed: int = 0
) -> list[Item]:
    """Return the order of some conditions for a participant, counterbalanced by the number.

    Participants 1, 2, ... take the rows of the square in turn: groups as large as its number of
    rows are balanced. A random order depends on seed and participant.
    """
    whole("participant", participant, 0)
    choice("order", design, get_args(BlockOrder))
    if design == "as-listed":
        return list(items)
    if design == "random":
        draw = np.random.default_rng([seed, participant])
        return [items[int(i)] for i in draw.permutation(len(items))]
    make = latin_square if design == "latin-square" else williams_square
    square = make(len(items))
    return [items[i] for i in square[(participant - 1) % len(square)]]


def seed_of(seed: int, *labels: str) -> int:
    """Return the seed of a session or a condition; no two have trials in the same order."""
    text = "/".join([str(seed), *labels])
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "big")


def shuffled(levels: Sequence[float], repeats: int, seed: int) -> list[tuple[float, ...]]:
    """Return all levels once in each repetition, in random order."""
    draw = np.random.default_rng(seed)
    return [(float(level),) for _ in range(repeats) for level in draw.permutation(list(levels))]
