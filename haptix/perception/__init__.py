"""Perception: detection thresholds and JND with their sources, and how far a stimulus is above."""

from haptix.perception.detection import (
    Component,
    Components,
    Detection,
    components_of_pull,
    detection,
)
from haptix.perception.in_time import SensationInTime
from haptix.perception.thresholds import (
    DEFAULT_FILE,
    WEBER_FRACTION,
    AmplitudeStep,
    Audibility,
    Channel,
    Difference,
    Perception,
)
from haptix.perception.weighting import WeightedError, weighted_error

__all__ = [
    "DEFAULT_FILE",
    "WEBER_FRACTION",
    "AmplitudeStep",
    "Audibility",
    "Channel",
    "Component",
    "Components",
    "Detection",
    "Difference",
    "Perception",
    "SensationInTime",
    "WeightedError",
    "components_of_pull",
    "detection",
    "weighted_error",
]
