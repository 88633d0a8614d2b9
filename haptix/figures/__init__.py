"""The figures of the paper and of the model's foundations, as numbers and as drawings.

Each figure is a function that returns its `FigureData`; `write_figures` draws them all.
"""

from haptix.figures.area_against_frequency import area_against_frequency
from haptix.figures.area_against_voltage import area_against_voltage
from haptix.figures.data import Curve, FigureData, Mark, Panel
from haptix.figures.drawing import draw
from haptix.figures.folder import FIGURES, Written, write_figures
from haptix.figures.friction_against_force import friction_against_force
from haptix.figures.friction_in_time import friction_in_time
from haptix.figures.gap_distributions import gap_distributions
from haptix.figures.roughness_spectra import roughness_spectra

__all__ = [
    "FIGURES",
    "Curve",
    "FigureData",
    "Mark",
    "Panel",
    "Written",
    "area_against_frequency",
    "area_against_voltage",
    "draw",
    "friction_against_force",
    "friction_in_time",
    "gap_distributions",
    "roughness_spectra",
    "write_figures",
]
