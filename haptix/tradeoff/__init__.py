"""The trade between error, time and memory, measured for a scene."""

from haptix.tradeoff.folder import write_tradeoff
from haptix.tradeoff.pareto import pareto_front
from haptix.tradeoff.run import Run, Tradeoff, run_tradeoff
from haptix.tradeoff.settings import Setting, default_scene

__all__ = [
    "Run",
    "Setting",
    "Tradeoff",
    "default_scene",
    "pareto_front",
    "run_tradeoff",
    "write_tradeoff",
]
