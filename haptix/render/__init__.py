"""Rendering: touch and texture to voltage, and voltage to a device."""

from haptix.render.modulation import Carrier
from haptix.render.renderer import RenderedBlock, Renderer, RenderStats
from haptix.render.trajectory import Trajectory

__all__ = ["Carrier", "RenderStats", "RenderedBlock", "Renderer", "Trajectory"]
