from . import render as render
from . import sensing as sensing
from . import simulation as simulation
from . import touch as touch
from . import virtual_finger as virtual_finger
