"""Adaptive methods that choose levels by the answers, and the experiment that presents them."""

from haptix.stimuli.adaptive.conditions import MethodsByCondition
from haptix.stimuli.adaptive.constant import ConstantStimuli, fit
from haptix.stimuli.adaptive.experiment import Experiment
from haptix.stimuli.adaptive.log import TrialLog
from haptix.stimuli.adaptive.method import Estimate, Method
from haptix.stimuli.adaptive.observer import Keys, Question, SimulatedObserver
from haptix.stimuli.adaptive.presentation import Presentation, Touch
from haptix.stimuli.adaptive.quest import Quest
from haptix.stimuli.adaptive.scaling import Magnitudes, Pairs
from haptix.stimuli.adaptive.session_plan import Catch, Exclude, Practice, SessionPlan, StopRules
from haptix.stimuli.adaptive.tasks import TASKS, Task
from haptix.stimuli.adaptive.updown import UpDown, weighted_up_down

METHODS: dict[str, type[Method]] = {
    one.kind: one for one in (UpDown, Quest, ConstantStimuli, Magnitudes, Pairs)
}
"""Every method by the name that recipes use."""

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
    "Task",
    "Touch",
    "TrialLog",
    "UpDown",
    "fit",
    "weighted_up_down",
]
