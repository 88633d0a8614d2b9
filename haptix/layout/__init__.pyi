from .geometry import ScreenGeometry as ScreenGeometry
from .layout import Layout as Layout
from .layout import LayoutEvent as LayoutEvent
from .layout import LayoutEventKind as LayoutEventKind
from .layout import Listeners as Listeners
from .layout import Patch as Patch
from .region_state import Outline as Outline
from .regions import Region as Region
