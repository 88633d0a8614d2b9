"""How fingers move: whole paths, and the blocks of them that a material is asked for."""

from haptix.base.fields import HARDEST_N, LIFTED_BELOW_N
from haptix.feel.motion.block import Depends, Facts, History, LocalFrame, Motion, Report
from haptix.feel.motion.trajectory import (
    FARTHEST_MM,
    STANDING_BELOW_MM_PER_S,
    VELOCITY_OVER_S,
    Trajectory,
)

__all__ = [
    "FARTHEST_MM",
    "HARDEST_N",
    "LIFTED_BELOW_N",
    "STANDING_BELOW_MM_PER_S",
    "VELOCITY_OVER_S",
    "Depends",
    "Facts",
    "History",
    "LocalFrame",
    "Motion",
    "Report",
    "Trajectory",
]
