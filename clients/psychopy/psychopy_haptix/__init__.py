"""Electrovibration stimuli of haptix in PsychoPy."""

__version__ = "0.1.0"
