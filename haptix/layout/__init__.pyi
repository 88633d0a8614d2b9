from .events import LayoutEvent as LayoutEvent
from .events import LayoutEventKind as LayoutEventKind
from .events import Listeners as Listeners
from .geometry import ScreenGeometry as ScreenGeometry
from .layout import Layout as Layout
from .outlines import Outline as Outline
from .patch import Patch as Patch
from .regions import Region as Region
