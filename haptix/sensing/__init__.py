"""Sensing: an unknown finger, known by the current that it draws."""

from haptix.sensing.contact import LATENT, ContactCurrent, PopulationSpread
from haptix.sensing.finger_observer import (
    EnrolledFinger,
    FingerEstimate,
    FingerObserver,
    Knowledge,
    Reading,
    SensingSettings,
)

__all__ = [
    "LATENT",
    "ContactCurrent",
    "EnrolledFinger",
    "FingerEstimate",
    "FingerObserver",
    "Knowledge",
    "PopulationSpread",
    "Reading",
    "SensingSettings",
]
