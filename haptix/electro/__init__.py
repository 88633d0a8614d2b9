"""Electrostatics of the contact: insulators in series, attraction against pressure."""

from haptix.electro.attraction import AreaFraction, Attraction, AttractionTable
from haptix.electro.dielectric import VACUUM_PERMITTIVITY, SkinDielectric
from haptix.electro.pull import Pull, drive_strength, drive_voltage

__all__ = [
    "VACUUM_PERMITTIVITY",
    "AreaFraction",
    "Attraction",
    "AttractionTable",
    "Pull",
    "SkinDielectric",
    "drive_strength",
    "drive_voltage",
]
