"""Rendering without hardware: a virtual finger feels the output of a mock device."""

from haptix.play.simulation.folder import FILES, errors_of, summary_of, write
from haptix.play.simulation.run import (
    FINGER_PATH,
    PARTS,
    Played,
    Setting,
    Simulation,
    evaluate_live,
    simulate,
)

__all__ = [
    "FILES",
    "FINGER_PATH",
    "PARTS",
    "Played",
    "Setting",
    "Simulation",
    "errors_of",
    "evaluate_live",
    "simulate",
    "summary_of",
    "write",
]
