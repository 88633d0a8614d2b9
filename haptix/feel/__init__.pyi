from . import gallery as gallery
from . import layout as layout
from . import materials as materials
from . import motion as motion
from . import signals as signals
