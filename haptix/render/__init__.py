"""Rendering: touch and texture to voltage, and voltage to a device."""

from haptix.render.block import Combination, RenderedBlock
from haptix.render.fingers import Sliding
from haptix.render.inverse import Amplitudes, SliceInverse, Wishes
from haptix.render.modulation import Carrier, DirectDrive, Envelope
from haptix.render.renderer import Renderer
from haptix.render.stats import RenderStats

__all__ = [
    "Amplitudes",
    "Carrier",
    "Combination",
    "DirectDrive",
    "Envelope",
    "RenderStats",
    "RenderedBlock",
    "Renderer",
    "SliceInverse",
    "Sliding",
    "Wishes",
]
