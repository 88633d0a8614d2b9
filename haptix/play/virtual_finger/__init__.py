"""The virtual finger, which feels a played voltage by the contact model itself."""

from haptix.play.virtual_finger.current import Converter, LiveCurrent, PanelCircuit, VirtualCurrent
from haptix.play.virtual_finger.felt import (
    FELT_WITHIN_S,
    Evaluation,
    Felt,
    SensedForce,
    SensedTouch,
    SensorModel,
    TouchPanel,
    evaluate,
)
from haptix.play.virtual_finger.finger import VirtualFinger

__all__ = [
    "FELT_WITHIN_S",
    "Converter",
    "Evaluation",
    "Felt",
    "LiveCurrent",
    "PanelCircuit",
    "SensedForce",
    "SensedTouch",
    "SensorModel",
    "TouchPanel",
    "VirtualCurrent",
    "VirtualFinger",
    "evaluate",
]
