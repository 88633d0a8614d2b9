"""What experiments of the tests play: a wave whose amplitude is the level."""

from __future__ import annotations

from typing import Any

from haptix.lab.experiment import Presentation


def at_level(wave: Any, scale: float = 1.0) -> Presentation:
    """The level is the wave's amplitude in dB re 1 V, against 0 V."""

    def peak(level: float) -> float:
        return scale * float(10 ** (level / 20))

    return Presentation(lambda level: peak(level) * wave, 0 * wave, peak)
