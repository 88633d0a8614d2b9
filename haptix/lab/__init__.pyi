from . import analysis as analysis
from . import experiment as experiment
from . import stimuli as stimuli
