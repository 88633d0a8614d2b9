"""A path on a texture, and what a mock device played of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from firmware_io import Device, open_device
from haptix.checks import Array
from haptix.errors import InputError
from haptix.friction import ContactModel
from haptix.motion import LIFTED_BELOW_N, Trajectory
from haptix.render import Drive, LiveRenderer, LiveSettings, Renderer
from haptix.render.core import DEFAULT_CARRIER_HZ
from haptix.surface import FrictionSurface, cached_surface
from haptix.texture import Feelable
from haptix.touch import TouchEvent, events_of
from haptix.virtual_finger import FELT_WITHIN_S, Felt, TouchPanel, VirtualFinger

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
        True finger and screen.
    texture : FrictionField or Material
        Target friction.
    path : Trajectory
        True path of the finger.
    drive : Drive, optional
        What the amplitude modulates; the default is the surface's carrier.

    Raises
    ------
    InputError
        If the path is shorter than ten periods of the drive.
    """

    model: ContactModel
    texture: Feelable
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


_ENDS_S = 0.01  # in which a driver has ramped to 0 V
_FEWEST_SAMPLES = 4  # that the virtual finger feels


@dataclass(frozen=True)
class Played:
    """What a renderer sent along a path, and what the device played.

    Parameters
    ----------
    setting : Setting
        Finger, screen, texture, path and drive.
    renderer : Renderer or LiveRenderer
        The renderer, with its counts, times and blocks.
    device : Device
        The device, closed.
    drive_v : ndarray, shape (samples,)
        Voltage that it played.
    start_s : float
        Time of the first sample on the path's clock [s].
    """

    setting: Setting
    renderer: Renderer | LiveRenderer
    device: Device
    drive_v: Array
    start_s: float

    def feel(self, finger: VirtualFinger, drive_v: Array | None = None) -> Felt:
        """Return what a finger on the path felt of a drive, or of what the device played."""
        drive_v = self.drive_v if drive_v is None else drive_v
        lacking = max(0, _FEWEST_SAMPLES - len(drive_v))
        drive_v = np.append(drive_v, np.zeros(lacking))
        path = self.setting.path
        along = (path.t_s, path.x_mm, path.y_mm, path.normal_force_n)
        return finger.feel(drive_v, self.renderer.sample_rate_hz, *along, self.start_s)

    def collected(self, name: str) -> Array:
        """Return one array of all blocks, joined."""
        return np.concatenate([getattr(block, name) for block in self.renderer.blocks])

    def is_settled(self, t_s: Array) -> npt.NDArray[np.bool_]:
        """Whether no fade lowers the amplitude at times [s], and the end is not near.

        The device ends with a ramp to 0 V; the virtual finger, band-limited to 5 kHz, feels the
        step to it a little early.
        """
        renderer = self.renderer
        at_s = self.start_s + self.collected("sample") / renderer.sample_rate_hz
        gain = np.concatenate(
            [b.gain if b.fingers else np.zeros(len(b.amplitude_v)) for b in renderer.blocks]
        )
        has_faded_in = np.interp(t_s, at_s, gain, left=0.0) == 1.0
        return np.asarray(has_faded_in & (t_s < at_s[-1] - FELT_WITHIN_S))


def play_known(
    setting: Setting,
    surface: FrictionSurface,
    settings: LiveSettings,
    address: str,
    on_progress: Callable[[float], None],
) -> Played:
    """Play the true path: no panel, latency or prediction."""
    device = _mock(address, "virtual")
    settings = replace(settings, keep_blocks=True)
    path = setting.path
    with Renderer(surface, setting.texture, device, setting.drive, settings) as renderer:
        touches = events_of(path)[:-1]  # without the lift
        for number, touch in enumerate(touches, 1):
            renderer.event(touch)
            on_progress(number / len(touches))
    return _played(setting, renderer, float(path.t_s[0]))


def play_live(
    setting: Setting,
    surface: FrictionSurface,
    panel: TouchPanel,
    settings: LiveSettings,
    address: str,
) -> Played:
    """Play what a touch panel reports of the path, as a live renderer does, in steps."""
    seen = panel.read(setting.path)
    device = _mock(address, "stepped")
    start_s = float(setting.path.t_s[0])
    with LiveRenderer(surface, setting.texture, device, setting.drive, settings) as renderer:
        columns = (seen.t_s, seen.x_mm, seen.y_mm, seen.normal_force_n, seen.arrival_s)
        for t, x, y, force, arrival in zip(*(c.tolist() for c in columns), strict=True):
            renderer.event(TouchEvent(t - start_s, 0, x, y, "move", force), arrival - start_s)
        renderer.run_until(max(renderer.now_s(), setting.path.duration_s))
    device.clock.sleep(_ENDS_S)
    return _played(setting, renderer, start_s)


def _played(setting: Setting, renderer: Renderer | LiveRenderer, start_s: float) -> Played:
    """Close the device, and say what it played."""
    device, driver = renderer.device, renderer.device.mock
    assert driver is not None
    device.close()
    return Played(setting, renderer, device, driver.played_v, start_s)


def _mock(address: str, pace: str) -> Device:
    """Open a mock device with the options of an address, at a pace."""
    scheme, _, options = address.partition(":")
    if scheme != "mock":
        raise InputError(f"device: expected a mock device, whose output can be felt, got {address}")
    kept = [option for option in options.split(",") if option and not option.startswith("pace=")]
    return open_device(f"mock:{','.join([*kept, f'pace={pace}'])}")
