"""Files of a set of stimuli, played on a device beside an experiment's own loop.

Knows haptix and not PsychoPy. A device may be used by one thread only: here by that of the stimulus
that plays.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

import haptix
from firmware_io import Device, DeviceBusyError
from firmware_io.clock import HOST_CLOCK
from haptix.base.errors import InputError
from haptix.feel.signals.audio_files import file_hash, read_drive

_CHUNK_S = 0.05
_AHEAD_S = 0.1  # samples in the driver, which are played out when a stimulus is stopped

_shared: dict[str, HaptixSession] = {}


class HaptixSession:
    """A device, open for an experiment.

    Parameters
    ----------
    address : str
        See `haptix.open_device`.

    Raises
    ------
    DeviceError
        If it cannot be opened.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self.device: Device = haptix.open_device(address)
        self.in_use = threading.Lock()

    @classmethod
    def shared(cls, address: str) -> HaptixSession:
        """Return the one session of this address, which all components of an experiment use."""
        if address not in _shared:
            _shared[address] = cls(address)
        return _shared[address]

    def close(self) -> None:
        """End at 0 V and close the device, behind a stimulus that plays. Idempotent."""
        _shared.pop(self.address, None)
        with self.in_use:
            self.device.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


class HapticStimulus:
    """One stimulus at a time, as a component of an experiment has it.

    Attributes
    ----------
    onset : float or None
        When its output began, by the clock that was given; None before, or if it was not played.
    onset_by : str
        "driver": by its mark of the first sample. "estimate": by its report of its progress.
    error : Exception or None
        What ended the last one; `stop` raises it.
    status : object
        PsychoPy's, which generated code sets.
    """

    def __init__(self, session: HaptixSession | str) -> None:
        self.session = HaptixSession.shared(session) if isinstance(session, str) else session
        self.onset: float | None = None
        self.onset_by = ""
        self.error: Exception | None = None
        self.status: object = None
        self.code, self.sha256 = 0, ""
        self._drive: npt.NDArray[np.float64] | None = None
        self._clock: Callable[[], float] = HOST_CLOCK
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def is_done(self) -> bool:
        """Whether nothing plays."""
        return self._thread is None or not self._thread.is_alive()

    def load(
        self, file: str | Path, code: int = 0, clock: Callable[[], float] = HOST_CLOCK
    ) -> None:
        """Read a file of a set, which is checked against its sidecar.

        Parameters
        ----------
        file : path-like
            WAV or FLAC beside its JSON.
        code : int
            What marks its first sample, 0 to 65535.
        clock : callable
            The experiment's clock, such as ``globalClock.getTime``.

        Raises
        ------
        InputError, FileFormatError
            If it is no file of a set, has changed, or has another rate than the device.
        """
        self.stop()
        place = Path(file)
        beside = place.with_suffix(".json")
        try:
            about: dict[str, Any] = json.loads(beside.read_text(encoding="utf-8"))
            full_scale_v, due = float(about["full_scale_v"]), str(about["sha256"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(
                f"{file}: expected a file of a set with its sidecar {beside.name} ({error}); make "
                "it by haptix stimuli make"
            ) from None
        drive, _, rate = read_drive(place, full_scale_v)
        if file_hash(place) != due:
            raise InputError(f"{file}: differs from what {beside.name} says; make the set again")
        mine = self.session.device.capabilities.sample_rate_hz
        if rate != mine or self.session.device.mode != "waveform":
            raise InputError(
                f"{file}: has {rate:g} samples a second, the device {mine:g} in mode "
                f"{self.session.device.mode}; open it with mode=waveform,sample_rate_hz={rate:g}"
            )
        self._drive, self._clock = drive, clock
        self.code, self.sha256 = code, due
        self.onset, self.onset_by, self.error = None, "", None

    def play(self) -> None:
        """Begin to play, and return at once.

        Raises
        ------
        InputError
            If nothing is loaded.
        DeviceBusyError
            If another stimulus plays on this device.
        """
        if self._drive is None:
            raise InputError("nothing is loaded; call load() with a file of a set first")
        if not self.session.in_use.acquire(blocking=False):
            raise DeviceBusyError(f"{self.session.address} plays another stimulus; stop it first")
        self._stopping.clear()
        self._thread = threading.Thread(target=self._run, args=(self._drive,), daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End at 0 V, and wait for that; no effect if nothing plays.

        Raises
        ------
        HaptixError
            What has ended it meanwhile.
        """
        self._stopping.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join()
        error, self.error = self.error, None
        if error is not None:
            raise error

    def close(self) -> None:
        """End the stimulus and its session, which other stimuli share. Idempotent."""
        try:
            self.stop()
        finally:
            self.session.close()

    def _run(self, drive: npt.NDArray[np.float64]) -> None:
        try:
            self._play(self.session.device, drive)
        # A thread has nobody to tell; `stop` raises it.
        except Exception as error:
            self.error = error
        finally:
            self.session.in_use.release()

    def _play(self, device: Device, drive: npt.NDArray[np.float64]) -> None:
        rate = device.capabilities.sample_rate_hz
        chunk, ahead = round(_CHUNK_S * rate), round(_AHEAD_S * rate)
        device.marked()  # what another stimulus left
        with device:
            if device.capabilities.takes_marks:
                device.mark(0, self.code)
            for first in range(0, drive.size, chunk):
                if self._stopping.is_set():
                    break
                device.write(drive[first : first + chunk])
                self._note_onset(device, rate)
                behind = first + chunk - device.progress().samples_played
                if behind > ahead:
                    self._stopping.wait(_CHUNK_S)
        self._note_onset(device, rate)

    def _note_onset(self, device: Device, rate: float) -> None:
        """Take the onset as soon as the driver has told it: by its mark, or by its progress."""
        if self.onset_by == "driver":
            return
        for mark in device.marked():
            if mark.sample_index == 0 and mark.time_s is not None:
                self._take_onset(mark.time_s, "driver")
                return
        if not self.onset_by and device.is_armed:
            found = device.progress()
            if found.is_playing and found.samples_played:
                self._take_onset(found.reported_s - found.samples_played / rate, "estimate")

    def _take_onset(self, host_s: float, by: str) -> None:
        self.onset, self.onset_by = host_s + self._clock() - HOST_CLOCK(), by
