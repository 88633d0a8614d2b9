"""Boundary elements: contact of rough surfaces solved point by point, with local attraction."""

from haptix.contact.boundary_elements.bounded import BoundedSolution
from haptix.contact.boundary_elements.coupled import LocalAttraction
from haptix.contact.boundary_elements.memory import estimated_bytes
from haptix.contact.boundary_elements.model import BoundaryElements
from haptix.contact.boundary_elements.resolution import ResolutionWarning
from haptix.contact.boundary_elements.results import ContactSolution
from haptix.contact.boundary_elements.surfaces import Surfaces

__all__ = [
    "BoundaryElements",
    "BoundedSolution",
    "ContactSolution",
    "LocalAttraction",
    "ResolutionWarning",
    "Surfaces",
    "estimated_bytes",
]
