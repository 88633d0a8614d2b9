from .bounded import BoundedSolution as BoundedSolution
from .coupled import LocalAttraction as LocalAttraction
from .elements import BoundaryElements as BoundaryElements
from .elements import ContactSolution as ContactSolution
from .ensemble import estimated_bytes as estimated_bytes
from .rough_surfaces import ResolutionWarning as ResolutionWarning
from .rough_surfaces import Surfaces as Surfaces
