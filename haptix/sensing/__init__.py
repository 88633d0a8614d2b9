"""Sensing: an unknown finger, known by the current that it draws."""

from haptix.sensing.contact import (
    LATENT,
    ContactChange,
    ContactCurrent,
    EnrolledFinger,
    PopulationSpread,
    contact_change,
)
from haptix.sensing.finger_observer import (
    FingerEstimate,
    FingerObserver,
    Knowledge,
    SensingSettings,
)

__all__ = [
    "LATENT",
    "ContactChange",
    "ContactCurrent",
    "EnrolledFinger",
    "FingerEstimate",
    "FingerObserver",
    "Knowledge",
    "PopulationSpread",
    "SensingSettings",
    "contact_change",
]
