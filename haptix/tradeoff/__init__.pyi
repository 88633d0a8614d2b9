from .files import write_tradeoff as write_tradeoff
from .runs import Run as Run
from .runs import Tradeoff as Tradeoff
from .runs import default_scene as default_scene
from .runs import pareto_front as pareto_front
from .runs import run_tradeoff as run_tradeoff
