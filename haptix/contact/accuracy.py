"""What boundary elements showed of a theory: where, and how exact it was there.

The numbers are those of docs/mean-field.md, on rows that none was fitted to. `of_states` gives each
state its own interval; beyond what was shown there is none.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, log

import torch
from torch import Tensor

from haptix.contact.meanfield import TheoryName

VALIDATED_X = 5e-5
"""Lowest ``x = p0/(E* slope)`` of boundary elements that the corrected theory was tested on without
having been fitted to them (docs/mean-field.md)."""

VALIDATED_WAVES = 4.0
"""Fewest waves of the roll-off, ``A0 (q_r/2 pi)^2``, under a contact of that comparison."""

SHOWN_ERRORS = ((5e-4, 3, 9, 8), (VALIDATED_X, 5, 28, 5))
"""Lowest x, and what was shown from there to the x before: median and largest error of the area,
largest error of the mean gap, in per cent of boundary elements, without voltage."""

UNDER_VOLTAGE = {"x": (3e-4, 5e-2), "h0/h_rms": (0.05, 1.0), "gaps' attraction/p0": (0.0, 20.0)}
"""Where rows under voltage were solved."""

_THIN = 0.15
"""h0/h_rms below which the interval of the ratio grows in inverse proportion."""

_RATIO_WIDTH = {"local": 0.075, "corrected": 0.31}
"""Half-width of the 90 % interval of ``ln mu(V)/mu(0)`` over that logarithm itself, by theory."""


@dataclass(frozen=True)
class Accuracy:
    """Half-widths of the theory's own 90 % intervals; tensors have the shape of the states.

    They are of the logarithm: mu lies within ``mu exp(+- half-width)``. A screen's and a finger's
    own numbers add to them.
    """

    mu: Tensor
    """Of mu; infinite where nothing was shown."""
    ratio: Tensor
    """Of mu(V)/mu(0); infinite where nothing was shown, 0 without voltage."""
    not_shown: tuple[str, ...]
    """What lies beyond the range of the comparison, and the range."""

    def __str__(self) -> str:
        if self.not_shown:
            return f"accuracy not shown: {'; '.join(self.not_shown)}"
        mu, ratio = (100 * torch.expm1(part.max()) for part in (self.mu, self.ratio))
        ratio_too = f", mu(V)/mu(0) within {float(ratio):.2g} %" if float(ratio) else ""
        return f"theory: mu within {float(mu):.2g} %{ratio_too} (90 % of boundary elements)"


def of_states(
    theory: TheoryName | None, x: Tensor, h0_over_h_rms: Tensor, pull_over_p0: Tensor, ratio: Tensor
) -> Accuracy:
    """Intervals of states.

    Parameters
    ----------
    theory : str, optional
        Name of the theory; None for models that are no mean field.
    x : Tensor
        ``p0/(E* slope)``.
    h0_over_h_rms : Tensor
        Magnitude of the insulators' thickness h0 over the roughness.
    pull_over_p0 : Tensor
        Mean attraction of the gaps over the applied pressure; 0 without voltage.
    ratio : Tensor
        mu(V)/mu(0).
    """
    x, h0_over_h_rms, pull_over_p0, ratio = (
        part.detach().to(torch.float64) for part in (x, h0_over_h_rms, pull_over_p0, ratio)
    )
    if theory not in _RATIO_WIDTH:
        none = torch.full_like(ratio, inf)
        name = "this model" if theory is None else f'the theory "{theory}"'
        return Accuracy(none, none, (f"{name} has no comparison",))
    alone = torch.full_like(ratio, inf)
    for least, _, worst, _ in reversed(SHOWN_ERRORS):
        alone = torch.where(x >= least, log(1 + worst / 100), alone)
    driven = pull_over_p0 > 0
    width = _RATIO_WIDTH[theory] * torch.log(ratio.clamp(min=1.0))
    width = width * (_THIN / h0_over_h_rms).clamp(min=1.0)
    reasons = beyond_validation(float(x.min()), inf)
    places = zip((x, h0_over_h_rms, pull_over_p0), UNDER_VOLTAGE.items(), strict=True)
    for value, (name, (least, most)) in places:
        outside = driven & ((value < least) | (value > most))
        width = torch.where(outside, inf, width)
        if bool(outside.any()):
            low, high = (float(end) for end in value[outside].aminmax())
            reached = f"{low:.2g}" if low == high else f"{low:.2g} to {high:.2g}"
            reasons.append(f"{name} of {reached} under voltage: shown from {least:g} to {most:g}")
    width = torch.where(driven, width, 0.0)
    return Accuracy(torch.hypot(alone, width), width, tuple(reasons))


def beyond_validation(x: float, rolloff_waves: float) -> list[str]:
    """Say what of a contact lies below what was validated; lowest values are given."""
    limits = []
    if x < VALIDATED_X:
        limits.append(f"x = p0/(E* slope) from {x:.2g}: validated from {VALIDATED_X:g}")
    if rolloff_waves < VALIDATED_WAVES:
        limits.append(
            f"{rolloff_waves:.3g} waves of the roll-off: validated from {VALIDATED_WAVES:g}"
        )
    return limits
