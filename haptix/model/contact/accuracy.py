"""The accuracy of a theory: how far its results lie from those of boundary elements.

The numbers are those of docs/mean-field.md; no theory was fitted to the rows that they come from.
`of_states` gives an interval for each state. Outside the range of the comparison the interval is
infinite.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, log
from typing import Any

import torch
from torch import Tensor

from haptix.base.display import Displayed
from haptix.model.contact.theories import TheoryName

VALIDATED_X = 5e-5
"""Lowest ``x = p0/(E* slope)`` at which boundary elements tested the corrected theory; it was not
fitted to these (docs/mean-field.md)."""

HEAVIEST_X = 0.1
"""Highest x of that comparison. At x = 0.3 the mean gap is 10 % too low, and the narrowest gaps are
far more than 10 % too low."""

VALIDATED_WAVES = 4.0
"""Smallest number of roll-off waves under a contact, ``A0 (q_r/2 pi)^2``, in that comparison."""

SHOWN_ERRORS = ((5e-4, 3, 9, 8), (VALIDATED_X, 5, 28, 5))
"""One row for each range of x, without voltage: lowest x of the range, median and largest error of
the area, largest error of the mean gap; errors in per cent of the boundary elements' values."""

_PULL = "gaps' attraction/p0"
UNDER_VOLTAGE = {"x": (1e-4, 5e-2), "h0/h_rms": (0.006, 1.0), _PULL: (0.0, 20.0)}
"""Ranges in which theory and boundary elements were compared under voltage."""

YIELDED = {
    "x": (5e-7, 6.2e-5),
    "A/A0": (3e-5, 1.2e-3),
    "h0/h_rms": (0.003, 0.015),
    _PULL: (0.0, 0.2),
}
"""The same for contacts whose spots all yield; x and A/A0 = p0/hardness without voltage too."""

_AT_REST = ("x", "A/A0")
_WHERE_YIELDED = "where all spots yield"

_THIN = 0.15
"""h0/h_rms below which the interval of the ratio grows, as h0/h_rms to the power of -0.7."""

_LIGHT = 3e-4
"""x below which it grows as 1/x: the gaps of few spots differ more from the mean field's."""

_RATIO_WIDTH = {"local": 0.055, "corrected": 0.31}
"""Half-width of the 90 % interval of ``ln mu(V)/mu(0)`` over that logarithm itself, by theory."""

_YIELDED_RATIO_WIDTH = {"local": 0.75}
"""The same where all spots yield: the ratio is close to 1 there, and its error in proportion."""

_YIELDED_WIDTH = log(1.1)
"""Half-width for mu there without voltage."""


@dataclass(frozen=True)
class Accuracy(Displayed):
    """Half-widths of the theory's 90 % intervals; tensors have the shape of the states.

    A half-width is one of the logarithm: mu lies within ``mu exp(+- half-width)``. The errors of a
    screen's and a finger's values come on top.
    """

    mu: Tensor
    """Half-width for mu; infinite outside the range of the comparison."""
    ratio: Tensor
    """Half-width for mu(V)/mu(0); infinite outside the range of the comparison, 0 without
    voltage."""
    not_shown: tuple[str, ...]
    """Each quantity that lies outside the range of the comparison, with the range."""

    def record(self) -> dict[str, Any]:
        """Largest half-widths in per cent (None if infinite), and the reasons of `not_shown`."""
        largest = {"mu": self.mu.max(), "ratio": self.ratio.max()}
        percent = {
            f"{name}_percent": 100 * float(torch.expm1(width)) if width < inf else None
            for name, width in largest.items()
        }
        return {**percent, "not_shown": list(self.not_shown), "says": str(self)}

    def __str__(self) -> str:
        if self.not_shown:
            return f"accuracy not shown: {'; '.join(self.not_shown)}"
        mu, ratio = (100 * torch.expm1(part.max()) for part in (self.mu, self.ratio))
        ratio_too = f", mu(V)/mu(0) within {float(ratio):.2g} %" if float(ratio) else ""
        return f"theory: mu within {float(mu):.2g} %{ratio_too} (90 % of boundary elements)"


def of_states(
    theory: TheoryName | None,
    x: Tensor,
    h0_over_h_rms: Tensor,
    pull_over_p0: Tensor,
    ratio: Tensor,
    yielded_area: Tensor | float = 0.0,
) -> Accuracy:
    """Return the accuracy of states; all tensors have the shape of the states.

    Parameters
    ----------
    theory : str, optional
        Name of the theory; None for a model that is not a mean field.
    x : Tensor
        ``p0/(E* slope)``.
    h0_over_h_rms : Tensor
        Magnitude of the insulators' thickness h0 over the roughness.
    pull_over_p0 : Tensor
        Mean attraction of the gaps over the applied pressure; 0 without voltage.
    ratio : Tensor
        mu(V)/mu(0).
    yielded_area : Tensor or float
        A/A0 without voltage where all contact spots yield, 0 elsewhere.
    """
    x, h0_over_h_rms, pull_over_p0, ratio = (
        part.detach().to(torch.float64) for part in (x, h0_over_h_rms, pull_over_p0, ratio)
    )
    yielded_area = torch.as_tensor(yielded_area).to(ratio).expand_as(ratio)
    yields = yielded_area > 0
    if theory not in _RATIO_WIDTH:
        unknown = torch.full_like(ratio, inf)
        name = "this model" if theory is None else f'the theory "{theory}"'
        return Accuracy(unknown, unknown, (f"{name} has no comparison",))
    at_rest = torch.full_like(ratio, inf)
    for least, _, worst, _ in reversed(SHOWN_ERRORS):
        in_range = (x >= least) & (x <= HEAVIEST_X)
        at_rest = torch.where(in_range, log(1 + worst / 100), at_rest)
    at_rest = torch.where(yields, _YIELDED_WIDTH, at_rest)
    driven = pull_over_p0 > 0
    width = _RATIO_WIDTH[theory] * (_THIN / h0_over_h_rms).clamp(min=1.0) ** 0.7
    width = width * (_LIGHT / x).clamp(min=1.0)
    width = torch.where(yields, _YIELDED_RATIO_WIDTH.get(theory, 0.0), width)
    width = width * torch.log(ratio.clamp(min=1.0))
    reasons = beyond_validation(x, yielded_area, inf)
    if theory not in _YIELDED_RATIO_WIDTH and bool(yields.any()):
        at_rest, width = (torch.where(yields, inf, part) for part in (at_rest, width))
        reasons.append(f'the theory "{theory}" has no comparison {_WHERE_YIELDED}')
    values = {"x": x, "A/A0": yielded_area, "h0/h_rms": h0_over_h_rms, _PULL: pull_over_p0}
    for ranges, kind, where in (
        (UNDER_VOLTAGE, driven & ~yields, "under voltage"),
        (YIELDED, yields, _WHERE_YIELDED),
    ):
        for name, ends in ranges.items():
            needs_no_drive = kind is yields and name in _AT_REST
            of_kind = kind if needs_no_drive else kind & driven
            outside = of_kind & ((values[name] < ends[0]) | (values[name] > ends[1]))
            width = torch.where(outside, inf, width)
            if needs_no_drive:
                at_rest = torch.where(outside, inf, at_rest)
            else:
                reasons += _beyond(name, values[name][of_kind], where, ends)
    width = torch.where(driven, width, 0.0)
    return Accuracy(torch.hypot(at_rest, width), width, tuple(reasons))


def _beyond(name: str, values: Tensor, where: str, ends: tuple[float, float]) -> list[str]:
    """Reason for values of a quantity that lie outside its range, if any."""
    least, most = ends
    outside = values[(values < least) | (values > most)]
    if not outside.numel():
        return []
    low, high = (float(end) for end in outside.aminmax())
    reached = f"{low:.2g}" if low == high else f"{low:.2g} to {high:.2g}"
    return [f"{name} of {reached} {where}: shown from {least:g} to {most:g}"]


def beyond_validation(x: Tensor, yielded_area: Tensor, rolloff_waves: float) -> list[str]:
    """Return one reason for each quantity of contacts that lies outside the validated range.

    Parameters
    ----------
    x : Tensor
        ``p0/(E* slope)`` of the contacts.
    yielded_area : Tensor
        A/A0 of those whose spots all yield, 0 for the others; of the shape of x.
    rolloff_waves : float
        Smallest number of roll-off waves under one of them.

    Examples
    --------
    >>> beyond_validation(torch.tensor([1e-2]), torch.tensor([0.0]), rolloff_waves=100.0)
    []
    """
    yields, limits = yielded_area > 0, []
    if not bool(yields.all()):
        lowest_x, highest_x = (float(end) for end in x[~yields].aminmax())
        if lowest_x < VALIDATED_X:
            limits.append(f"x = p0/(E* slope) from {lowest_x:.2g}: validated from {VALIDATED_X:g}")
        if highest_x > HEAVIEST_X:
            limits.append(f"x = p0/(E* slope) to {highest_x:.2g}: validated up to {HEAVIEST_X:g}")
    for name, values in zip(_AT_REST, (x, yielded_area), strict=True):
        limits += _beyond(name, values[yields], _WHERE_YIELDED, YIELDED[name])
    if rolloff_waves < VALIDATED_WAVES:
        limits.append(
            f"{rolloff_waves:.3g} waves of the roll-off: validated from {VALIDATED_WAVES:g}"
        )
    return limits
