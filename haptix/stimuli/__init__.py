"""Offline stimuli: signals, sets, files, and the methods that choose among them."""

from haptix.stimuli.algebra import Concatenation, Excerpt, Product, Repetition, Sum, Window
from haptix.stimuli.apparatus import Apparatus
from haptix.stimuli.making import SetResult, check_manifest
from haptix.stimuli.noise import Noise
from haptix.stimuli.population import Population
from haptix.stimuli.rendering import Rendering
from haptix.stimuli.signal import Constant, Signal, signal_from
from haptix.stimuli.space import Grating, Relief
from haptix.stimuli.speed import Path, SpeedProfile, SteadySpeed, Strokes
from haptix.stimuli.stimulus import Stimulus
from haptix.stimuli.stimulus_set import StimulusSet
from haptix.stimuli.trials import TrialPlan
from haptix.stimuli.waves import Chirp, Points, Pulse, Ramp, Recorded, Sine, Square, Step

__all__ = [
    "Apparatus",
    "Chirp",
    "Concatenation",
    "Constant",
    "Excerpt",
    "Grating",
    "Noise",
    "Path",
    "Points",
    "Population",
    "Product",
    "Pulse",
    "Ramp",
    "Recorded",
    "Relief",
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
    "TrialPlan",
    "Window",
    "check_manifest",
    "signal_from",
]
