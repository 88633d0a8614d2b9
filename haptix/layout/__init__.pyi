from .geometry import ScreenGeometry as ScreenGeometry
from .layout import Layout as Layout
from .layout import Patch as Patch
from .outlines import Outline as Outline
