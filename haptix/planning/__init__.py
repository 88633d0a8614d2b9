"""Planning: model only what a scene requires, and say why."""

from haptix.planning.plan import Plan, Row, plan_scene
from haptix.planning.trials import Effect

__all__ = ["Effect", "Plan", "Row", "plan_scene"]
