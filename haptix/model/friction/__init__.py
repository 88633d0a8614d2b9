"""Friction of a finger on a screen: a solver of loads, and the contact model around it."""

from haptix.model.friction.model import HIGHEST_FORCE_N, LOWEST_FORCE_N, ContactModel, in_theory
from haptix.model.friction.placeholders import placeholder_spread
from haptix.model.friction.solver import FrictionSolver

__all__ = [
    "HIGHEST_FORCE_N",
    "LOWEST_FORCE_N",
    "ContactModel",
    "FrictionSolver",
    "in_theory",
    "placeholder_spread",
]
