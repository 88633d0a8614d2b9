"""The virtual finger: what was played, felt through the contact model itself."""

from haptix.twin.finger import Felt, VirtualFinger
from haptix.twin.path import LIFTED_BELOW_N, STANDING_BELOW_MM_PER_S
from haptix.twin.response import CUTOFF_HZ_PER_MM_PER_S
from haptix.twin.sensor import SensedForce, SensorModel
from haptix.twin.touch_panel import SensedTouch, TouchPanel
from haptix.twin.verdict import FELT_WITHIN_S, Verdict, judge

__all__ = [
    "CUTOFF_HZ_PER_MM_PER_S",
    "FELT_WITHIN_S",
    "LIFTED_BELOW_N",
    "STANDING_BELOW_MM_PER_S",
    "Felt",
    "SensedForce",
    "SensedTouch",
    "SensorModel",
    "TouchPanel",
    "Verdict",
    "VirtualFinger",
    "judge",
]
