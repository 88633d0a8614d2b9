"""Electrostatics of the contact: insulators in series, attraction against pressure."""

from haptix.electro.attraction import (
    AreaFraction,
    Attraction,
    AttractionTable,
    drive_strength,
    drive_voltage,
)
from haptix.electro.dielectric import (
    VACUUM_PERMITTIVITY,
    SkinDielectric,
    effective_thickness,
)

__all__ = [
    "VACUUM_PERMITTIVITY",
    "AreaFraction",
    "Attraction",
    "AttractionTable",
    "SkinDielectric",
    "drive_strength",
    "drive_voltage",
    "effective_thickness",
]
