from .rendering import Apparatus as Apparatus
from .rendering import Rendering as Rendering
from .set_plan import TrialPlan as TrialPlan
from .stimulus import Stimulus as Stimulus
from .stimulus_set import SetResult as SetResult
from .stimulus_set import StimulusSet as StimulusSet
from .stimulus_set import check_manifest as check_manifest
