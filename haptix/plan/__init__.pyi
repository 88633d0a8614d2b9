from .planning import Plan as Plan
from .planning import plan_scene as plan_scene
from .scene import Scene as Scene
from .tradeoff import Tradeoff as Tradeoff
from .tradeoff import run_tradeoff as run_tradeoff
from .tradeoff import write_tradeoff as write_tradeoff
