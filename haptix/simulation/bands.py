"""Compare a compact texture with its recording: energies of felt friction in nine bands."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from haptix.checks import Array
from haptix.friction import ContactModel
from haptix.motion import Trajectory
from haptix.render import LiveSettings
from haptix.simulation.simulation import Setting, play_known
from haptix.surface import FrictionSurface, cached_surface
from haptix.texture import Feelable, RecordedProfile
from haptix.texture.spectral import (
    BANDS_HZ,
    Energies,
    Spectral,
    Stretch,
    band_energies,
    decibels,
)
from haptix.virtual_finger import VirtualFinger

CASES = ((20.0, 0.2), (20.0, 0.8), (45.0, 0.4), (100.0, 0.2), (100.0, 0.8))
"""Speeds [mm/s] and normal forces [N] at which a texture is compared with its recording."""

WITHIN_DB = 1.0
"""How near the felt level of a band must be."""

_LEAD_MM = 10.0  # left out at the start, while the drive fades in
_STEP_S = 0.01  # between corners of the path
_FELT_HZ = 5_000.0  # the attraction is followed up to a fifth: the highest band
_TOLERANCE = "0.02 JND"
_CARRIER_HZ = 4000.0


@dataclass(frozen=True)
class BandError:
    """Felt level of a texture's band against that of its recording, at a speed and a force."""

    speed_mm_per_s: float
    normal_force_n: float
    band: int
    """From 0; between ``BANDS_HZ[band]`` and the next."""
    recorded_db: float
    """Level of the felt changes of friction over the friction [dB]."""
    error_db: float

    @property
    def is_near(self) -> bool:
        """Whether it is within `WITHIN_DB`."""
        return abs(self.error_db) <= WITHIN_DB


def felt_errors(
    model: ContactModel,
    texture: Spectral,
    recorded: Sequence[Stretch],
    on_progress: Callable[[float], None] = lambda share: None,
) -> Iterator[BandError]:
    """Yield the error of each band that was recorded, at each speed and force.

    The finger feels the longest stroke of the recording as it is, and one tile of the texture as
    it repeats. One renderer plays both as relative changes of friction around one mean.
    """
    stretch = max(recorded, key=lambda stroke: stroke.length_mm)
    x = _LEAD_MM + stretch.step_mm * np.arange(len(stretch.change))
    profile = RecordedProfile(x, texture.mean + stretch.change, "contrast", beyond="hold")
    surface, _ = cached_surface(
        model,
        {"normal_force_n": (0.2, 0.8), "frequency_hz": _CARRIER_HZ},
        _TOLERANCE,
    )
    finger, known = VirtualFinger(model), Energies([stretch])
    for number, (speed, force) in enumerate(CASES, 1):
        levels = [
            decibels(_felt(surface, finger, what, length, speed, force, is_periodic))
            for what, length, is_periodic in (
                (profile, stretch.length_mm, False),
                (texture, texture.tile_mm, True),
            )
        ]
        on_progress(number / len(CASES))
        for band in np.flatnonzero(np.isfinite(known.levels_db(speed))).tolist():
            recorded_db, given_db = float(levels[0][band]), float(levels[1][band])
            yield BandError(speed, force, band, recorded_db, given_db - recorded_db)


def _felt(
    surface: FrictionSurface,
    finger: VirtualFinger,
    what: Feelable,
    length_mm: float,
    speed: float,
    force: float,
    is_periodic: bool,
) -> Array:
    """Return energies of the relative changes of friction that a finger feels, shape (bands,)."""
    end_s = (_LEAD_MM + length_mm + 1) / speed
    t = np.append(np.arange(0.0, end_s, _STEP_S), end_s)
    path = Trajectory(t, speed * t, np.full_like(t, 5.0), np.full_like(t, force))
    setting = Setting(finger.model, what, path)
    played = play_known(setting, surface, LiveSettings(), "mock:", lambda share: None)
    along = (path.t_s, path.x_mm, path.y_mm, path.normal_force_n)
    rate_hz = played.renderer.sample_rate_hz
    mu = finger.feel(played.drive_v, rate_hz, *along, played.start_s, _FELT_HZ).mu
    first = round(_LEAD_MM / speed * _FELT_HZ)
    mu = mu[first : first + round(length_mm / speed * _FELT_HZ)]
    return band_energies(mu / mu.mean() - 1, _FELT_HZ, is_periodic)


def band_name(band: int) -> str:
    """Return the range of a band, such as ``10-17 Hz``."""
    return f"{BANDS_HZ[band]:.0f}-{BANDS_HZ[band + 1]:.0f} Hz"
