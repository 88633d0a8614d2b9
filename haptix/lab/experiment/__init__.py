"""Adaptive methods that choose levels by the answers, and the experiment that presents them."""

from haptix.lab.experiment.comparisons import Magnitudes, Pairs, Sorting, Triads
from haptix.lab.experiment.methods import ConstantStimuli, Method, MethodsByCondition
from haptix.lab.experiment.observer import Keys, Question, SimulatedObserver
from haptix.lab.experiment.procedures import METHODS, Quest, UpDown, weighted_up_down
from haptix.lab.experiment.psychometric import Estimate, fit
from haptix.lab.experiment.session_plan import (
    TASKS,
    Catch,
    Exclude,
    Practice,
    SessionPlan,
    StopRules,
    TrialTask,
)
from haptix.lab.experiment.trial_log import TrialLog
from haptix.lab.experiment.trials import Experiment, Presentation, StrokeRanges, Touch

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
    "Sorting",
    "StopRules",
    "StrokeRanges",
    "Touch",
    "Triads",
    "TrialLog",
    "TrialTask",
    "UpDown",
    "fit",
    "weighted_up_down",
]
