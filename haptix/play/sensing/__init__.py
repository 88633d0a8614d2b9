"""Sensing: an unknown finger, known by the current that it draws.

Experimental: no driver has a sensor yet, and all fingers that it learned were simulated.
"""

from haptix.play.sensing.contact import (
    LATENT,
    ContactChange,
    ContactCurrent,
    EnrolledFinger,
    PopulationSpread,
    contact_change,
)
from haptix.play.sensing.finger_observer import (
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
