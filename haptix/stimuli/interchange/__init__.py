"""Haptic interchange: friction maps, AHAP and MPEG haptics (HJIF), each with what is lost."""

from haptix.stimuli.interchange.ahap import read_ahap, write_ahap
from haptix.stimuli.interchange.friction_map import FrictionMap
from haptix.stimuli.interchange.hjif import read_hjif, write_hjif

__all__ = ["FrictionMap", "read_ahap", "read_hjif", "write_ahap", "write_hjif"]
