"""Periodic waves: their phase on a sample clock, and their shape over one period."""

from haptix.waves.phase import sine, turns
from haptix.waves.waveform import Shape, Waveform

__all__ = ["Shape", "Waveform", "sine", "turns"]
