"""Adaptive methods that choose levels by the answers, and the experiment that presents them."""

from haptix.stimuli.adaptive.experiment import Experiment, Presentation, StrokeRanges, Touch
from haptix.stimuli.adaptive.methods import (
    ConstantStimuli,
    Magnitudes,
    Method,
    MethodsByCondition,
    Pairs,
)
from haptix.stimuli.adaptive.observer import Keys, Question, SimulatedObserver
from haptix.stimuli.adaptive.procedures import METHODS, Quest, UpDown, weighted_up_down
from haptix.stimuli.adaptive.psychometric import Estimate, fit
from haptix.stimuli.adaptive.session_plan import (
    TASKS,
    Catch,
    Exclude,
    Practice,
    SessionPlan,
    StopRules,
    TrialTask,
)
from haptix.stimuli.adaptive.trial_log import TrialLog

__all__ = [
    "METHODS",
    "TASKS",
    "Catch",
    "ConstantStimuli",
    "Estimate",
    "Exclude",
    "Experiment",
    "Keys",
    "Magnitudes",
    "Method",
    "MethodsByCondition",
    "Pairs",
    "Practice",
    "Presentation",
    "Quest",
    "Question",
    "SessionPlan",
    "SimulatedObserver",
    "StopRules",
    "StrokeRanges",
    "Touch",
    "TrialLog",
    "TrialTask",
    "UpDown",
    "fit",
    "weighted_up_down",
]
