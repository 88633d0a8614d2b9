"""A package of somebody else that brings a kind of material and one of signal, each by one line."""

import os
import subprocess
import sys

FILE = '''
from typing import Literal

import numpy as np
from pydantic import PositiveFloat

from haptix.feel.materials import Scaled
from haptix.feel import Signal


class Wool(Scaled):
    """Loops of a thread across the stroke.

    Parameters
    ----------
    loop_mm : float
        Distance from one loop to the next.
    """

    kind: Literal["wool"] = "wool"
    loop_mm: PositiveFloat = 4.0

    def wanted(self, motion):
        return self.scaled(np.abs(np.sin(np.pi * motion.x_mm / self.loop_mm)))


class Fall(Signal):
    """A value that falls by half in `half_s`."""

    value: float
    half_s: PositiveFloat
    length_s: PositiveFloat = 1.0
    kind: Literal["fall"] = "fall"

    def _inside(self, first, count, sample_rate_hz):
        return self.value * 0.5 ** (np.arange(first, first + count) / sample_rate_hz / self.half_s)
'''

PROJECT = """
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "wool-of-a-stranger"
version = "1.0"

[tool.hatch.build.targets.wheel]
include = ["wool.py"]

[project.entry-points."haptix.feel.materials"]
wool = "wool:Wool"

[project.entry-points."haptix.feel.signals"]
fall = "wool:Fall"
"""


def installed(folder):
    """Install the package into a folder of its own; return the environment that finds it."""
    (folder / "source").mkdir(parents=True)
    (folder / "source" / "wool.py").write_text(FILE)
    (folder / "source" / "pyproject.toml").write_text(PROJECT)
    target = folder / "installed"
    options = ["--no-index", "--no-deps", "--no-build-isolation", "--disable-pip-version-check"]
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "-q", *options, "--target", target,
         folder / "source"],
        check=True,
    )  # fmt: skip
    return os.environ | {"PYTHONPATH": str(target)}
