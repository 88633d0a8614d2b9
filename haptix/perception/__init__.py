"""Perception: thresholds of touch with their sources, and the rule of two channels."""

from haptix.perception.data import Audibility, Channel, Perception
from haptix.perception.rule import Component, Detection, components_of_pull, detection

WEBER_FRACTION: float = Perception.default().weber_fraction
"""Just-noticeable difference of friction over the friction, of the file that ships."""

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
