"""Planning: model only what a scene requires, and say why."""

from haptix.planning.plan import BuildSurface, Plan, Row, holding, plan_scene
from haptix.planning.trials import Effect

__all__ = ["BuildSurface", "Effect", "Plan", "Row", "holding", "plan_scene"]
