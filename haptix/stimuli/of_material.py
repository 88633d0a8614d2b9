"""A material of any kind under a finger on a path, as a signal."""

from __future__ import annotations

from functools import lru_cache
from math import ceil, inf, log2
from typing import Any, Literal

import numpy as np
from pydantic import Field

from haptix.kinds import by_content
from haptix.materials import AnyMaterial
from haptix.motion import VELOCITY_OVER_S, Depends, History, Motion, Report
from haptix.motion.block import Reactions
from haptix.signals.signal import Array, Length, Number, Positive, Signal
from haptix.stimuli.along_path import AnySpeed
from haptix.texture import TargetKind

_REPORT_S = 1e-3  # between what a material hears of the finger


class MaterialSignal(Signal):
    """What a material asks for where the finger is: along x at a height `y_mm`, with all detail.

    Time counts from the first sample, at which the finger comes down. The force is constant, so
    that no button is pressed. A detent counts from the first millisecond at which it has been
    crossed, so that no sample depends on later ones.

    Parameters
    ----------
    of : Material
        Or its table, or the path of its file.
    speed : SpeedProfile or float
        How the finger moves; a number is a steady speed [mm/s].
    y_mm : float
        Where.
    normal_force_n : float
        Normal force [N]; in a stimulus, that of the stimulus.
    length_s : float
        Length.
    """

    of: AnyMaterial
    speed: AnySpeed = Field(None, validate_default=True)
    y_mm: Number = 0.0
    normal_force_n: Positive = 0.5
    length_s: Length = inf
    kind: Literal["material"] = "material"

    @property
    def target(self) -> TargetKind:
        """What the values are."""
        return self.of.evaluator.target

    def describe(self) -> dict[str, Any]:
        """Everything that determines the values; files of the material by their content."""
        with by_content():
            return super().describe()

    def _inside(self, first: int, count: int, sample_rate_hz: float) -> Array:
        evaluator = self.of.evaluator
        t = np.arange(first, first + count) / sample_rate_hz
        half = VELOCITY_OVER_S / 2
        ahead, behind = (self.speed.position_mm(t + by) for by in (half, -half))
        history: History = ()
        if Depends.FACTS in evaluator.depends_on:
            # Powers of two, so that of blocks one after the other each finds few facts anew.
            history = _facts(self, 2 ** ceil(log2(t[-1] + 2 * _REPORT_S)))
        motion = Motion.of(
            self.speed.position_mm(t), self.y_mm, t, (ahead - behind) / VELOCITY_OVER_S, 0.0,
            self.normal_force_n, history=history,
        )  # fmt: skip
        return evaluator.wanted(motion)


@lru_cache(maxsize=8)
def _facts(signal: MaterialSignal, until_s: float) -> History:
    """Facts of the finger on its path until a time."""
    reactions, react = Reactions(kept=None), signal.of.evaluator.react
    t = np.arange(0.0, until_s, _REPORT_S)
    for t_s, x_mm in zip(t.tolist(), signal.speed.position_mm(t).tolist(), strict=True):
        reactions.report(Report(t_s, x_mm, signal.y_mm, signal.normal_force_n), react, t_s)
    return reactions.history
