"""What a finger can tell: thresholds, as data with sources, and the rule of two channels."""

from haptix.perception.data import Audibility, Channel, Perception
from haptix.perception.rule import Component, Detection, components_of_pull, detection

WEBER_FRACTION: float = Perception.default().weber_fraction
"""Smallest relative change of friction that is felt, of the file that ships."""

__all__ = [
    "WEBER_FRACTION",
    "Audibility",
    "Channel",
    "Component",
    "Detection",
    "Perception",
    "components_of_pull",
    "detection",
]
