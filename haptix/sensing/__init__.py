"""Sensing: an unknown finger, known by the current that it draws."""

from haptix.sensing.contact import LATENT, ContactCurrent, PopulationSpread
from haptix.sensing.finger_observer import (
    FingerEstimate,
    FingerObserver,
    Knowledge,
    SensingSettings,
)
from haptix.sensing.person import ContactChange, EnrolledFinger, contact_change

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
