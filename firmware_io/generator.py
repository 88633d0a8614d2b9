"""A function generator as a driver, by SCPI: whole stimuli, uploaded and played once.

Laboratories have one. It is no link of `open_device`: it cannot be revised while it plays, and an
upload takes longer than a touch. The waveform has passed the firmware, in virtual time, with all
of its limits. It begins and ends at 0 V and is played once, so that nothing stands at the output
when the host dies.

The commands are those of Keysight's 33500B and 33600A, written from memory of their manual. They
were tried against a simulated instrument alone (PyVISA-sim), never with a generator.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from firmware_io.device import Device
from firmware_io.device_errors import DeviceDisconnectedError, DeviceError, from_extra
from firmware_io.limits import ABSOLUTE_CEILING_V
from firmware_io.links.mock import MockDriver, MockLink
from firmware_io.protocol import FULL_SCALE_CODE, codes_to_volts

OUTPUT_HZ = 48_000
_REST_S = 0.05  # in which the firmware has ramped to 0 V behind the last sample
_LOOK_S = 0.05
_PATIENCE_MS = 30_000  # an upload is some 400 kB of text, which it reads before it answers
_NO_ERROR = "+0"


@dataclass(frozen=True, kw_only=True)
class GeneratorProfile:
    """A generator and the amplifier behind it.

    Raises `DeviceError` if a number is impossible.
    """

    amplifier_gain: float
    """Gain of the amplifier, in V/V."""
    ceiling_v: float = ABSOLUTE_CEILING_V
    """Largest voltage that amplifier and screen withstand."""
    highest_v: float = 10.0
    """Largest peak voltage of the generator into an open output."""
    memory_samples: int = 65_536
    """Samples that a waveform may have: 1.4 s at 48 kHz."""

    def __post_init__(self) -> None:
        for name in ("amplifier_gain", "highest_v"):
            if not 0 < getattr(self, name) <= 1e6:
                raise DeviceError(
                    f"{name} must be above 0 and at most 1e6, but is {getattr(self, name)!r:.60}."
                )
        if not 0 < self.ceiling_v <= ABSOLUTE_CEILING_V:
            raise DeviceError(
                f"ceiling_v must be above 0 and at most {ABSOLUTE_CEILING_V:g} V, but is "
                f"{self.ceiling_v!r:.60}."
            )


class FunctionGenerator:
    """Plays whole stimuli on a function generator; its output is off before and after each.

    Parameters
    ----------
    resource : str
        Its VISA resource, such as ``TCPIP0::10.0.0.5::INSTR``.
    profile : GeneratorProfile
        Generator and amplifier.
    backend : str
        Library of PyVISA, such as ``@py``; empty for its own choice.
    sleep : callable
        Lets time pass while it plays, in seconds.

    Raises
    ------
    MissingExtraError
        If pyvisa is not installed (``pip install 'haptix-electrovibration[generator]'``).
    DeviceError
        If nothing answers, or the instrument reports an error.

    Examples
    --------
    >>> profile = GeneratorProfile(amplifier_gain=20.0, ceiling_v=150.0)
    >>> with FunctionGenerator("TCPIP0::10.0.0.5::INSTR", profile) as generator:  # doctest: +SKIP
    ...     generator.play(100.0 * np.sin(2 * np.pi * 120 * np.arange(48_000) / 48_000))
    """

    def __init__(
        self,
        resource: str,
        profile: GeneratorProfile,
        backend: str = "",
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        with from_extra("generator"):
            import pyvisa
        self.name, self._profile, self._sleep = f"scpi:{resource}", profile, sleep
        self._instrument: Any = None
        try:
            self._instrument = pyvisa.ResourceManager(backend).open_resource(resource)
            if not isinstance(self._instrument, pyvisa.resources.MessageBasedResource):
                raise ValueError("it is no resource that takes commands")
            self._instrument.read_termination = self._instrument.write_termination = "\n"
            self._instrument.timeout = _PATIENCE_MS
            self.identity = str(self._instrument.query("*IDN?")).strip()
            if not self.identity:
                raise ValueError("it returned nothing to *IDN?")
            self._tell("*CLS", "OUTP1 OFF", "OUTP1:LOAD INF")
        except (pyvisa.Error, OSError, ValueError, DeviceError) as error:
            self.close()
            raise DeviceError(
                f"{self.name} does not answer: {error}; check the resource, the cable and that no "
                "other program has it."
            ) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Switch the output off and close the connection. Idempotent."""
        instrument, self._instrument = self._instrument, None
        if instrument is not None:
            with suppress(Exception):  # the connection may be gone; the waveform has ended at 0 V
                instrument.write("OUTP1 OFF")
            instrument.close()

    def play(
        self,
        samples_v: npt.ArrayLike,
        sample_rate_hz: float = OUTPUT_HZ,
        carrier_hz: float | None = None,
    ) -> npt.NDArray[np.float64]:
        """Upload a stimulus, play it once, and return when it has ended.

        Parameters
        ----------
        samples_v : array-like, shape (n,)
            The drive at the screen [V]; with `carrier_hz` its amplitude.
        sample_rate_hz : float
            48, 16 or 8 kHz.
        carrier_hz : float, optional
            Carrier that is modulated [Hz].

        Returns
        -------
        ndarray, shape (m,)
            Samples at 48 kHz [V at the screen]: with the ramp at their end.

        Raises
        ------
        LimitError, DeviceFaultError
            If a sample breaks a limit; nothing has been sent to the generator then.
        DeviceError
            If it is too long or too high for the generator, or the generator reports an error.
        DeviceDisconnectedError
            If the connection is gone; the stimulus ends at 0 V by itself.
        """
        if self._instrument is None:
            raise DeviceDisconnectedError(f"{self.name} is closed; open it again before playing.")
        drive_v = self._rendered(samples_v, sample_rate_hz, carrier_hz)
        profile = self._profile
        if drive_v.size > profile.memory_samples:
            raise DeviceError(
                f"The stimulus has {drive_v.size} samples at {OUTPUT_HZ} Hz, and {self.name} keeps "
                f"{profile.memory_samples}; shorten it, or state memory_samples of your generator."
            )
        peak_v = float(np.abs(drive_v).max()) / profile.amplifier_gain
        if peak_v > profile.highest_v:
            raise DeviceError(
                f"The stimulus needs {peak_v:.3g} V of the generator, which gives "
                f"{profile.highest_v:g} V; take an amplifier of a higher gain."
            )
        if peak_v == 0:
            return drive_v
        codes = np.rint(drive_v / profile.amplifier_gain / peak_v * FULL_SCALE_CODE).astype(int)
        try:
            self._upload(codes, peak_v)
            self._tell("OUTP1 ON", "*TRG")
            for _ in range(int(drive_v.size / OUTPUT_HZ / _LOOK_S) + 2):
                self._sleep(_LOOK_S)
        finally:
            self._tell("OUTP1 OFF")
        return drive_v

    def _rendered(
        self, samples_v: npt.ArrayLike, rate_hz: float, carrier_hz: float | None
    ) -> npt.NDArray[np.float64]:
        """Let the firmware play the samples in virtual time; return its output, from 0 V to 0 V."""
        ceiling_v = self._profile.ceiling_v
        driver = MockDriver(sample_rate_hz=OUTPUT_HZ, full_scale_v=ceiling_v, ceiling_v=ceiling_v)
        mode: Any = {"mode": "waveform"}
        if carrier_hz is not None:
            mode = {"mode": "envelope", "carrier_hz": carrier_hz}
        with Device(MockLink(driver), sample_rate_hz=rate_hz, **mode) as device:
            device.arm()
            device.write(samples_v)
        driver.advance(_REST_S)
        codes = driver.output[0]
        played = np.flatnonzero(codes)
        if not played.size:
            return np.zeros(1)
        return np.asarray(codes_to_volts(codes[played[0] - 1 : played[-1] + 2], ceiling_v), float)

    def _upload(self, codes: npt.NDArray[np.int_], peak_v: float) -> None:
        self._tell(
            "SOUR1:DATA:VOL:CLE",
            f"SOUR1:DATA:ARB:DAC haptix,{','.join(map(str, codes))}",
            "SOUR1:FUNC:ARB haptix",
            f"SOUR1:FUNC:ARB:SRAT {OUTPUT_HZ}",
            "SOUR1:FUNC ARB",
            "SOUR1:VOLT:OFFS 0",
            f"SOUR1:VOLT {2 * peak_v:.6g}",  # from the lowest to the highest code
            "SOUR1:BURS:MODE TRIG",
            "SOUR1:BURS:NCYC 1",
            "SOUR1:BURS:STAT ON",
            "TRIG1:SOUR BUS",
        )

    def _tell(self, *commands: str) -> None:
        """Send commands one by one, and ask after each: the next may switch the output on."""
        import pyvisa

        for command in commands:
            try:
                self._instrument.write(command)
                answer = str(self._instrument.query("SYST:ERR?"))
            except UnicodeDecodeError as error:
                answer = f"its answer {error.object!r:.60} is no text"
            except (pyvisa.Error, OSError) as error:
                raise DeviceDisconnectedError(
                    f"{self.name} is gone at {command:.40}: {error}; its waveform ends at 0 V by "
                    "itself. Switch its output off by hand, then open it again."
                ) from None
            if not answer.startswith(_NO_ERROR):
                raise DeviceError(f"{self.name} refuses {command:.40}: {answer.strip()}")


class TraceCheck(NamedTuple):
    """A recorded trace against the waveform: its gain, offset, delay and largest difference."""

    gain: float
    """Of the trace by the drive, 1 for a rig that is as its profile states."""
    offset_v: float
    delay_s: float
    """Of the trace behind the begin of the drive."""
    largest_difference_v: float
    """Of the trace from gain times the delayed drive, and the offset."""


def check_trace(
    drive_v: npt.ArrayLike, trace_v: npt.ArrayLike, trace_rate_hz: float, probe: float = 1.0
) -> TraceCheck:
    """Compare an oscilloscope's trace with the drive that was played.

    Gain and offset are those of least squares at the delay of the largest correlation, to a small
    share of the drive's sample: half a sample at 4 kHz would look like a gain of 0.97.

    Parameters
    ----------
    drive_v : array-like, shape (m,)
        What `FunctionGenerator.play` returned, at 48 kHz [V].
    trace_v : array-like, shape (n,)
        The trace, which holds all of the drive [V at the oscilloscope].
    trace_rate_hz : float
        Its samples a second.
    probe : float
        Volts at the screen by volts at the oscilloscope, such as 100.

    Returns
    -------
    TraceCheck
        Of volts at the screen.

    Raises
    ------
    DeviceError
        If the trace is shorter than the drive or no list of finite volts, the drive is 0 V
        throughout, or the rate is not above 0.

    Examples
    --------
    >>> drive = np.sin(2 * np.pi * 100 * np.arange(4800) / 48_000) * np.hanning(4800)
    >>> trace = np.concatenate([np.zeros(480), 0.9 * drive, np.zeros(480)])
    >>> check = check_trace(drive, trace, 48_000)
    >>> round(check.gain, 3), round(check.delay_s, 4)
    (0.9, 0.01)
    """
    drive = np.asarray(drive_v, float)
    trace = probe * np.asarray(trace_v, float)
    if trace.ndim != 1 or drive.ndim != 1 or not (np.isfinite(trace).all() and trace_rate_hz > 0):
        raise DeviceError(
            f"Drive and trace must be lists of finite volts and the rate above 0 Hz, but came in "
            f"shapes {drive.shape} and {trace.shape} at {trace_rate_hz!r:.60} Hz; take the column "
            "of volts, and cut off samples beyond the oscilloscope's range."
        )
    if trace.size / trace_rate_hz < drive.size / OUTPUT_HZ or not drive.any():
        raise DeviceError(
            f"The trace has {trace.size / trace_rate_hz:.3g} s, and the drive "
            f"{drive.size / OUTPUT_HZ:.3g} s; record all of it."
        )
    at_s = np.arange(int(trace.size / trace_rate_hz * OUTPUT_HZ)) / OUTPUT_HZ
    seen = np.interp(at_s, np.arange(trace.size) / trace_rate_hz, trace)
    n = seen.size + drive.size
    spectrum = np.fft.rfft(seen - seen.mean(), n) * np.fft.rfft(drive, n).conj()
    delay = int(np.argmax(np.fft.irfft(spectrum, n)[: seen.size - drive.size + 1]))
    turn = 2j * np.pi * np.fft.rfftfreq(n)  # of a shift by one sample
    part = _peak(lambda shift: float((spectrum * np.exp(turn * (delay + shift))).real.sum()))
    window = seen[delay : delay + drive.size]
    shifted = np.fft.irfft(np.fft.rfft(drive, n) * np.exp(-turn * part), n)[: drive.size]
    (gain, offset), *_ = np.linalg.lstsq(
        np.column_stack([shifted, np.ones_like(shifted)]), window, rcond=None
    )
    difference = float(np.abs(window - gain * shifted - offset).max())
    return TraceCheck(float(gain), float(offset), (delay + part) / OUTPUT_HZ, difference)


def _peak(height: Callable[[float], float]) -> float:
    """Place of the highest point of a smooth function near 0, by the tops of parabolas."""
    place, step = 0.0, 0.5
    for _ in range(4):
        low, middle, high = (height(place + off) for off in (-step, 0.0, step))
        bend = low - 2 * middle + high
        place += step * min(max((low - high) / (2 * bend), -1.0), 1.0) if bend < 0 else 0.0
        step /= 4
    return place
