from .folder import write_tradeoff as write_tradeoff
from .run import Tradeoff as Tradeoff
from .run import run_tradeoff as run_tradeoff
from .settings import Run as Run
from .settings import SurfaceSetting as SurfaceSetting
from .settings import default_scene as default_scene
from .settings import pareto_front as pareto_front
