"""Fingers that feel a carrier part by part, as it is played."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from haptix.checks import Array
from haptix.errors import InputError
from haptix.motion import Trajectory
from haptix.virtual_finger.finger import VirtualFinger
from haptix.virtual_finger.played import Amplitude
from haptix.virtual_finger.sensing import Felt


class LiveVirtualFinger:
    """Feels as `VirtualFinger.feel_carrier` does, in parts that follow each other.

    Parameters
    ----------
    finger : VirtualFinger
        Finger and screen.
    frequency_hz : float
        Of the carrier.
    rate_hz : float
        Of what is felt.
    """

    def __init__(self, finger: VirtualFinger, frequency_hz: float, rate_hz: float = 1000.0) -> None:
        self._finger, self.rate_hz = finger, rate_hz
        self._thickness = finger.thickness_m(frequency_hz)
        self._field = finger.field_of(Amplitude(np.zeros(1), 1.0, 0.0, self._thickness))
        self._before: dict[int, Array | None] = {}
        self._end_s: dict[int, float] = {}

    def feel(
        self,
        amplitude_v: Array,
        sample_rate_hz: float,
        start_s: float,
        paths: Mapping[int, Trajectory],
    ) -> dict[int, Felt]:
        """Return what fingers on several paths feel; the last time of each begins its next part.

        Parameters
        ----------
        amplitude_v : ndarray, shape (samples,)
            Amplitude [V] of the carrier, linear between samples; 0 V outside.
        sample_rate_hz, start_s : float
            Rate of these samples, and time of the first.
        paths : mapping of int to Trajectory
            True path of each finger. One that does not begin where its part before ended begins
            from rest.

        Raises
        ------
        InputError
            If a path is shorter than a sample.
        """
        drive = Amplitude(amplitude_v, sample_rate_hz, start_s, self._thickness)
        sensed = {}
        for number, path in paths.items():
            count = round(path.duration_s * self.rate_hz)
            if count < 1:
                raise InputError(f"paths: expected {1 / self.rate_hz:g} s or more")
            goes_on = abs(self._end_s.get(number, -1.0) - path.t_s[0]) < 0.5 / self.rate_hz
            before = self._before.get(number) if goes_on else None
            part = self._finger.sense(drive, self._field, path, count, self.rate_hz, before)
            self._before[number] = part.after
            self._end_s[number] = float(path.t_s[-1])
            sensed[number] = part
        if not sensed:
            return {}
        felt = self._finger.felt(list(sensed.values()), self._field)
        return dict(zip(sensed, felt, strict=True))
