"""Rendering without hardware: a finger on a texture, a simulated driver, and what was felt."""

from haptix.simulation.folder import FILES, summary_of, write
from haptix.simulation.parts import PARTS
from haptix.simulation.run import Simulation, simulate
from haptix.simulation.setting import FINGER_PATH, Setting

__all__ = [
    "FILES",
    "FINGER_PATH",
    "PARTS",
    "Setting",
    "Simulation",
    "simulate",
    "summary_of",
    "write",
]
