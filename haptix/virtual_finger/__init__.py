"""The virtual finger: what was played, felt through the contact model itself."""

from haptix.motion import LIFTED_BELOW_N, STANDING_BELOW_MM_PER_S
from haptix.virtual_finger.evaluation import FELT_WITHIN_S, Evaluation, evaluate
from haptix.virtual_finger.finger import VirtualFinger
from haptix.virtual_finger.sensing import Felt, SensedForce, SensedTouch, SensorModel, TouchPanel

__all__ = [
    "FELT_WITHIN_S",
    "LIFTED_BELOW_N",
    "STANDING_BELOW_MM_PER_S",
    "Evaluation",
    "Felt",
    "SensedForce",
    "SensedTouch",
    "SensorModel",
    "TouchPanel",
    "VirtualFinger",
    "evaluate",
]
