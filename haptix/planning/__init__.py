"""Planning: model only what a scene requires, and say why."""

from haptix.planning.effects import Effect
from haptix.planning.plan import Plan, Row, plan_scene

__all__ = ["Effect", "Plan", "Row", "plan_scene"]
