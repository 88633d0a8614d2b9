"""How a touch panel lies on the picture: turned, mirrored, or by any affine map."""

from __future__ import annotations

import os
from collections.abc import Collection
from contextlib import suppress
from math import isfinite
from pathlib import Path

import numpy as np
import numpy.typing as npt

from haptix.base.errors import InputError

Matrix = tuple[float, float, float, float, float, float]
"""Rows of an affine map of places as shares of the panel, as libinput has it."""

ORIENTATIONS: dict[str, Matrix] = {
    "normal": (1, 0, 0, 0, 1, 0),
    "turn-90": (0, -1, 1, 1, 0, 0),
    "turn-180": (-1, 0, 1, 0, -1, 1),
    "turn-270": (0, 1, 0, -1, 0, 1),
    "mirror-x": (-1, 0, 1, 0, 1, 0),
    "mirror-y": (1, 0, 0, 0, -1, 1),
    "swap": (0, 1, 0, 1, 0, 0),
}
"""Names of common matrices; turns are clockwise, as the person sees it."""


def checked_matrix(matrix: Matrix | str | Collection[float]) -> Matrix:
    """Return a calibration matrix by its name or its six numbers; `InputError` if it is none."""
    expected = f"six numbers of a map that can be inverted, or one of {', '.join(ORIENTATIONS)}"
    if isinstance(matrix, str):
        if matrix in ORIENTATIONS:
            return ORIENTATIONS[matrix]
        try:
            matrix = [float(word) for word in matrix.replace(",", " ").split()]
        except ValueError:
            raise InputError(f"matrix: expected {expected}, got {matrix!r:.80}") from None
    values = tuple(matrix)
    if len(values) == 6 and all(isfinite(value) for value in values):
        a, b, _, d, e, _ = values
        if abs(a * e - b * d) > 1e-3:
            return values
    raise InputError(f"matrix: expected {expected}, got {values!r:.80}")


def is_turned(matrix: Matrix) -> bool:
    """Return whether the panel's x runs along the picture's height."""
    a, b, _, d, e, _ = matrix
    return abs(b) + abs(d) > abs(a) + abs(e)


def system_matrix(path: str | Path, root: Path = Path("/")) -> Matrix:
    """Return udev's LIBINPUT_CALIBRATION_MATRIX of a device; the map of no change without one.

    Parameters
    ----------
    path : path
        Device file.
    root : Path
        Where ``run/udev`` lies.

    Raises
    ------
    InputError
        If it is not six numbers of a map.
    """
    text = ""
    with suppress(OSError):
        number = Path(path).stat().st_rdev
        file = root / f"run/udev/data/c{os.major(number)}:{os.minor(number)}"
        text = file.read_text(encoding="utf-8", errors="replace")
    key = "E:LIBINPUT_CALIBRATION_MATRIX="
    values = [line.removeprefix(key) for line in text.splitlines() if line.startswith(key)]
    try:
        return checked_matrix(values[-1] if values else "normal")
    except InputError as error:
        raise InputError(f"udev's LIBINPUT_CALIBRATION_MATRIX: {error}") from None


def fitted_matrix(
    panel: npt.ArrayLike, picture: npt.ArrayLike
) -> tuple[Matrix, npt.NDArray[np.float64]]:
    """Return the map from places on a panel to those on the picture, and how far each is off it.

    Parameters
    ----------
    panel, picture : array-like, shape (points, 2)
        The same three places or more, as shares of the panel's axes and of the picture's sides.

    Returns
    -------
    matrix : tuple of 6 float
        By least squares.
    off : ndarray, shape (points, 2)
        Distance of each place along the picture's sides, as shares.

    Examples
    --------
    >>> turned = [(1, 0), (1, 1), (0, 1), (0, 0)]
    >>> matrix, off = fitted_matrix([(0, 0), (1, 0), (1, 1), (0, 1)], turned)
    >>> [round(number, 9) + 0 for number in matrix], bool(abs(off).max() < 1e-9)
    ([0.0, -1.0, 1.0, 1.0, 0.0, 0.0], True)
    """
    at, there = np.asarray(panel, dtype=float), np.asarray(picture, dtype=float)
    ones = np.column_stack([at, np.ones(len(at))])
    solved, _, rank, _ = np.linalg.lstsq(ones, there, rcond=1e-3)
    if rank < 3:
        raise InputError("touchscreen: expected places that are no line, got the same side twice")
    a, b, c, d, e, f = solved.T.ravel().tolist()
    return checked_matrix((a, b, c, d, e, f)), np.asarray(ones @ solved - there)
