"""Largest error of a surface, as a person writes it; this module does not import torch."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, Literal, Self, get_args

from haptix.base.errors import InputError

if TYPE_CHECKING:
    from torch import Tensor

Unit = Literal["mu", "JND", "percent of range"]

_SPELLINGS: dict[str, Unit] = {
    **dict.fromkeys(("", "mu"), "mu"),
    **dict.fromkeys(("JND", "jnd", "threshold", "thresholds"), "JND"),
    **dict.fromkeys(("%", "percent", "percent of range"), "percent of range"),
}

# The model's tables are no more exact than this: a finer surface would grow to its largest size.
LEAST: dict[Unit, float] = {"mu": 1e-6, "JND": 1e-5, "percent of range": 1e-4}
"""Smallest value of a tolerance, by its unit."""


@dataclass(frozen=True)
class Tolerance:
    """Largest error of friction.

    Parameters
    ----------
    value : float
        At least 1e-6 in mu, 1e-5 JND or 1e-4 percent: the model is no more exact.
    unit : {"mu", "JND", "percent of range"}
        Friction coefficient; just-noticeable differences, of ``0.11 mu`` each; or percent of the
        span between the lowest and the highest mu of the surface.

    Raises
    ------
    InputError
        If the value is not finite or below the least, or the unit is unknown.

    Examples
    --------
    >>> str(Tolerance.read("0.05 JND"))
    '0.05 JND'
    """

    value: float
    unit: Unit = "mu"

    def __post_init__(self) -> None:
        if not (isfinite(self.value) and self.value > 0):
            raise InputError(f"tolerance: expected an error in mu above 0, got {self.value:g}")
        if self.unit not in get_args(Unit):
            raise InputError(
                f"tolerance: expected a unit of {', '.join(get_args(Unit))}, got {self.unit!r}"
            )
        if self.value < LEAST[self.unit]:
            raise InputError(
                f"tolerance: expected at least {LEAST[self.unit]:g} {self.unit}, since the model "
                f"is no more exact, got {self.value:g}"
            )

    @classmethod
    def read(cls, value: Self | float | str) -> Self:
        """Read ``0.002``, ``"0.002"``, ``"0.05 JND"`` or ``"0.2 %"``.

        Examples
        --------
        >>> Tolerance.read(0.01)
        Tolerance(value=0.01, unit='mu')
        """
        if isinstance(value, cls):
            return value
        if isinstance(value, bool):
            raise InputError(f"tolerance: expected a number in mu, got {value}")
        match = re.fullmatch(r"\s*([-+.\deE]+|nan|inf)\s*([A-Za-z% ]*?)\s*", str(value))
        number, unit = match.groups() if match else ("", "")
        try:
            read = float(number), _SPELLINGS[unit]
        except (KeyError, ValueError):
            raise InputError(
                f'tolerance: expected a number in mu, "0.05 JND" or "0.2 %", got {value!r}'
            ) from None
        return cls(*read)

    def __str__(self) -> str:
        return f"{self.value:g} {self.unit}"

    def unit_in_mu(self, mu: Tensor, low: float, high: float) -> Tensor | float:
        """Size of the unit at friction `mu`, where mu runs from `low` to `high`.

        Parameters
        ----------
        mu : Tensor
        low, high : float
            Range of friction of the whole surface.
        """
        if self.unit == "JND":
            from haptix.model.perception.thresholds import WEBER_FRACTION  # with numpy and torch

            return WEBER_FRACTION * mu
        if self.unit == "percent of range":
            return max(high - low, 1e-12 * high) / 100
        return 1.0
