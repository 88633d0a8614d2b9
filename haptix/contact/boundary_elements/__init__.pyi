from .bounded import BoundedSolution as BoundedSolution
from .coupled import LocalAttraction as LocalAttraction
from .memory import estimated_bytes as estimated_bytes
from .model import BoundaryElements as BoundaryElements
from .resolution import ResolutionWarning as ResolutionWarning
from .results import ContactSolution as ContactSolution
from .surfaces import Surfaces as Surfaces
