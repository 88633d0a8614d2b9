"""What is simulated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from haptix.errors import InputError
from haptix.friction import ContactModel
from haptix.motion import LIFTED_BELOW_N, Trajectory
from haptix.render import Drive
from haptix.render.core import DEFAULT_CARRIER_HZ
from haptix.surface import FrictionSurface, cached_surface
from haptix.texture import FrictionField

FINGER_PATH = Path(__file__).parent / "finger_path.csv"
"""A recorded path of a finger, for the examples and `haptix demo`."""

_FEWEST_PERIODS = 10
_TOLERANCE = 5e-4  # of the surface, in mu; a sixtieth of a JND at mu = 0.27


@dataclass(frozen=True)
class Setting:
    """A finger on a screen, and the texture that it is to feel along a path.

    Parameters
    ----------
    model : ContactModel
        Finger and screen, as they truly are.
    texture : FrictionField
        What to feel.
    path : Trajectory
        Where the finger truly is.
    drive : Drive, optional
        What the amplitude modulates; the default is the surface's carrier.

    Raises
    ------
    InputError
        If the path is shorter than ten periods of the drive.
    """

    model: ContactModel
    texture: FrictionField
    path: Trajectory
    drive: Drive | None = None

    def __post_init__(self) -> None:
        frequency_hz = self._frequency_hz
        if self.path.duration_s * frequency_hz < _FEWEST_PERIODS:
            raise InputError(
                f"trajectory: expected {_FEWEST_PERIODS} periods or more of the "
                f"{frequency_hz:g} Hz drive, got {self.path.duration_s:g} s; give a "
                "longer path or a higher frequency"
            )

    def surface(
        self, on_progress: Callable[[float], None] | None = None
    ) -> tuple[FrictionSurface, bool]:
        """Load or build a surface for the path's forces; say whether it came from the cache."""
        force = self.path.normal_force_n
        touching = force[force >= LIFTED_BELOW_N]
        if not len(touching):
            raise InputError("trajectory: expected a finger that touches, got no force above 0 N")
        scene = {
            "normal_force_n": (float(touching.min()), float(touching.max())),
            "frequency_hz": self._frequency_hz,
        }
        return cached_surface(self.model, scene, _TOLERANCE, on_progress)

    @property
    def _frequency_hz(self) -> float:
        return DEFAULT_CARRIER_HZ if self.drive is None else self.drive.frequency_hz
