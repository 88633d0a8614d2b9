"""Place the fewest nodes of an axis that keep linear interpolation within a tolerance."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

CellError = Callable[[int, int], float]
"""Largest error inside a cell between two points; it grows with the cell."""


def fewest_nodes(points: int, error: CellError, tolerance: float) -> list[int]:
    """Choose nodes among points so that the error of no cell exceeds the tolerance.

    Each cell is made as long as possible. Then all cells are made a little shorter, as long as this
    costs no node, so that the last cell is not the only short one. The first and the last point are
    always nodes. The error of a cell between neighbouring points is taken as 0.
    """
    nodes = _longest_cells(points, error, tolerance, points)
    for share in (0.5, 0.7, 0.85):
        shorter = _longest_cells(points, error, share * tolerance, len(nodes))
        if shorter[-1] == points - 1:
            return shorter
    return nodes


def _longest_cells(points: int, error: CellError, tolerance: float, most: int) -> list[int]:
    """Nodes from the first point on: up to the last, or as far as `most` of them go."""
    nodes = [0]
    while nodes[-1] < points - 1 and len(nodes) < most:
        start, good, bad = nodes[-1], nodes[-1] + 1, points
        reach = 2
        while good < bad - 1:  # doubling first: most cells are short
            end = min(start + reach, (good + bad) // 2 if bad < points else points - 1)
            end = max(end, good + 1)
            if error(start, end) <= tolerance:
                good, reach = end, 2 * reach
            else:
                bad = end
        nodes.append(good)
    return nodes


def chord_error(values: Tensor, at: Tensor, start: int, end: int) -> Tensor:
    """Chord minus curve inside a cell, shape (inner points, ...).

    The curves have `values`, shape (points, ...), at positions `at`, shape (points,).
    """
    share = (at[start + 1 : end] - at[start]) / (at[end] - at[start])
    share = share.reshape(-1, *([1] * (values.ndim - 1)))
    return torch.lerp(values[start], values[end], share) - values[start + 1 : end]
