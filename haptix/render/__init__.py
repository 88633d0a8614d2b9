"""Rendering: touch and texture to voltage, and voltage to a device."""

from haptix.render.core import RenderCore, RenderedBlock, RenderState
from haptix.render.drive import DirectWave, Drive, SineCarrier
from haptix.render.live import LiveRenderer, PredictingRenderer
from haptix.render.motion import Motion
from haptix.render.renderer import Renderer
from haptix.render.settings import Combination, LiveSettings, RenderSettings, Sliding
from haptix.render.stats import RenderStats

__all__ = [
    "Combination",
    "DirectWave",
    "Drive",
    "LiveRenderer",
    "LiveSettings",
    "Motion",
    "PredictingRenderer",
    "RenderCore",
    "RenderSettings",
    "RenderState",
    "RenderStats",
    "RenderedBlock",
    "Renderer",
    "SineCarrier",
    "Sliding",
]
