"""Offline stimuli: signals, sets, files, and the methods that choose among them."""

from haptix.feel.along_path import (
    AlongPath,
    MaterialSignal,
    Path,
    SpeedProfile,
    SteadySpeed,
    Strokes,
    grating,
    relief,
)
from haptix.feel.signals.shapes import (
    Chirp,
    Morph,
    Points,
    Pulse,
    Ramp,
    Recorded,
    Sine,
    Square,
    Step,
    TimeNoise,
)
from haptix.feel.signals.signal import (
    Concatenation,
    Constant,
    Excerpt,
    Product,
    Repetition,
    Signal,
    Sum,
    Window,
    signal_from,
)
from haptix.lab.population import Population
from haptix.lab.stimuli.rendering import Apparatus, Rendering
from haptix.lab.stimuli.set_plan import TrialPlan
from haptix.lab.stimuli.stimulus import Stimulus
from haptix.lab.stimuli.stimulus_set import SetResult, StimulusSet, check_manifest

__all__ = [
    "AlongPath",
    "Apparatus",
    "Chirp",
    "Concatenation",
    "Constant",
    "Excerpt",
    "MaterialSignal",
    "Morph",
    "Path",
    "Points",
    "Population",
    "Product",
    "Pulse",
    "Ramp",
    "Recorded",
    "Rendering",
    "Repetition",
    "SetResult",
    "Signal",
    "Sine",
    "SpeedProfile",
    "Square",
    "SteadySpeed",
    "Step",
    "Stimulus",
    "StimulusSet",
    "Strokes",
    "Sum",
    "TimeNoise",
    "TrialPlan",
    "Window",
    "check_manifest",
    "grating",
    "relief",
    "signal_from",
]
