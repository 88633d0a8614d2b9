"""An analog output of National Instruments with a high-voltage amplifier, by NI-DAQmx.

The card's own clock times the samples. The firmware runs on the host. If the host dies, a watchdog
of the card ends the drive, or an interlock that the address states. The module is written against
the interface of nidaqmx; no card has been driven yet.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from firmware_io.clock import raise_priority
from firmware_io.device_errors import DeviceBusyError, DeviceError, DeviceNotFoundError, from_extra
from firmware_io.limits import WATCHDOG_S
from firmware_io.link import Bus, DeviceInfo, Scheme, number
from firmware_io.links.hosted import HostedLink, RigProfile, read_rig_profile
from firmware_io.protocol import FULL_SCALE_CODE

_HIGHEST_BUFFER_S = 0.5
_LEAST_STATEMENT = 8  # letters of the statement of an interlock


@dataclass(frozen=True, kw_only=True)
class DaqProfile(RigProfile):
    """The analog output and the amplifier behind it; `amplifier_gain` is needed.

    Raises `DeviceError` if nothing ends the drive when the host dies, or a value is missing or
    impossible.
    """

    device_name: ClassVar[str] = "analog output"

    channel: str = ""
    """The output, such as ``Dev1/ao0``."""
    watchdog: str | None = None
    """Output that the card's watchdog takes to 0 when the host dies: ``yes`` for the analog output
    (chassis of CompactDAQ), or a digital line that enables the amplifier, such as
    ``Dev1/port0/line0`` (X Series, whose watchdog knows lines only)."""
    interlock: str | None = None
    """Without a watchdog: what takes the voltage off the screen then, in words."""
    trigger: str | None = None
    """A second output of the card, as a digital line: 5 V for 1 ms from the first sample of each
    playback and from each mark."""
    monitor: str | None = None
    """An input of the card that reads the output back, such as ``Dev1/_ao0_vs_aognd``."""
    buffer_s: float = 0.03
    """Samples that wait for the card's clock, in seconds."""
    dac_full_scale_v: float | None = 10.0
    sample_rate_hz: float = 50_000.0  # divides the timebase of 100 MHz

    def __post_init__(self) -> None:
        if not self.channel:
            raise DeviceError("daq: needs the analog output, as in channel=Dev1/ao0.")
        if self.amplifier_gain is None or self.dac_full_scale_v is None:
            raise DeviceError(
                "daq: needs amplifier_gain, in V/V: the card knows its own volts only."
            )
        if self.watchdog is not None and self.watchdog != "yes" and "/" not in self.watchdog:
            raise DeviceError(
                f"watchdog of daq: must be yes, or a digital line as Dev1/port0/line0, but is "
                f"{self.watchdog!r:.60}."
            )
        if not self.watchdog and len((self.interlock or "").strip()) < _LEAST_STATEMENT:
            raise DeviceError(
                "A card may hold its last voltage when its host dies: give watchdog=yes if the "
                "card has a watchdog for this output, watchdog= with the digital line that enables "
                "the amplifier, or say by interlock= in a few words what takes the voltage off "
                "the screen then."
            )
        if not 0.002 <= self.buffer_s <= _HIGHEST_BUFFER_S:
            raise DeviceError(
                f"buffer_s must be 0.002 to {_HIGHEST_BUFFER_S:g}, but is {self.buffer_s!r:.60}."
            )
        super().__post_init__()

    @property
    def screen_full_scale_v(self) -> float:
        """Volts on the screen at digital full scale: no more than the ceiling needs."""
        assert self.dac_full_scale_v is not None and self.amplifier_gain is not None
        return min(self.ceiling_v, self.dac_full_scale_v * self.amplifier_gain)

    @property
    def card_full_scale_v(self) -> float:
        """Volts of the card at digital full scale, beyond which it refuses samples itself."""
        assert self.amplifier_gain is not None
        return self.screen_full_scale_v / self.amplifier_gain

    @property
    def line_of_amplifier(self) -> str | None:
        """The digital line that enables the amplifier, as long as the watchdog is fed."""
        return None if self.watchdog == "yes" else self.watchdog

    @property
    def has_line(self) -> bool:
        """Whether a second output is its digital line."""
        return self.trigger is not None


#: Allowed difference of the monitor's readings from the samples, for its noise and gain error. At
#: an edge it reads the voltage before it, or the one after it if that settles soon.
_MONITOR_SHARE = 0.02
_MONITOR_BEFORE = 2  # samples
#: Number of wrong readings that end the output, and of right readings that cancel a wrong one. A
#: glitch passes; an output that stands or has another gain does not, though it is right at times.
_MONITOR_MOST = 8
_MONITOR_FORGIVEN = 1 / 16


class DaqMonitor:
    """Compares readings with samples of the same clock.

    Parameters
    ----------
    task : nidaqmx.Task
        Reads one input by the output's clock.
    full_v : float
        Volts of the card at digital full scale.
    most_waiting : int
        Samples that may be written and not yet read.
    """

    def __init__(self, task: Any, full_v: float, most_waiting: int) -> None:
        self.task = task
        self._full_v = full_v
        self._sent: deque[float] = deque(maxlen=most_waiting + _MONITOR_BEFORE)
        self._written = self._seen = 0  # samples
        self._strange = 0.0

    def take(self, volts: npt.NDArray[np.float64]) -> None:
        """Add samples that were written [V at the card]."""
        self._sent.extend(volts.tolist())
        self._written += volts.size

    def compare(self) -> None:
        """Compare the readings since the last call.

        Raises `DeviceError` if they differ from the samples for longer than a glitch.
        """
        count = self.task.in_stream.avail_samp_per_chan
        if count == 0:
            return
        read = np.asarray(self.task.read(number_of_samples_per_channel=count), dtype=float)
        oldest = self._written - len(self._sent)
        sent = np.fromiter(self._sent, float, len(self._sent))
        off = beyond(read, sent, self._seen - oldest, self._full_v)
        self._seen += count
        for is_off in off:
            self._strange = max(0.0, self._strange + (1.0 if is_off else -_MONITOR_FORGIVEN))
            if self._strange >= _MONITOR_MOST:
                raise DeviceError("its monitor reads other volts than were written")


def beyond(
    read: npt.NDArray[np.float64], sent: npt.NDArray[np.float64], first: int, full_v: float
) -> npt.NDArray[np.bool_]:
    """Return where readings, from index `first`, lie outside the range of the last few samples."""
    places = first + np.arange(read.size)[:, None]
    around = places + np.arange(-_MONITOR_BEFORE, 1)
    near = np.where(around < 0, 0.0, sent[np.clip(around, 0, sent.size - 1)])
    room = _MONITOR_SHARE * full_v
    return np.asarray((read < near.min(axis=1) - room) | (read > near.max(axis=1) + room))


_LINE_V = 5.0  # high level of the digital line on a second output
_MOST_RATE_ERROR = 1e-3  # share by which a clock that divides the card's timebase may be off
STILL_S = WATCHDOG_S  # a clock that has stopped for so long holds a voltage
_NOT_INSTALLED = {
    "DaqNotFoundError": "NI-DAQmx is not installed: install it",
    "DaqFunctionNotSupportedError": "NI-DAQmx is too old: install a newer one",
}
_RESERVED = (-50103, -201105)  # DAQmx: the resource is reserved
_UNKNOWN = (-200220, -200170)  # DAQmx: no such device, no such channel


class DaqLink(HostedLink):
    """The firmware, playing into an analog output by the card's own clock.

    Opening takes a second, in which the output is held at 0 V. Raises `DeviceNotFoundError` or
    `DeviceBusyError` or `DeviceError` if the card cannot be opened, or has no such watchdog;
    `MissingExtraError` if nidaqmx is not installed.

    Parameters
    ----------
    profile : DaqProfile
        The output, the amplifier, and the watchdog or interlock.
    """

    def __init__(self, profile: DaqProfile) -> None:
        self._daq = nidaqmx_module()
        self._profile = profile
        self._lead = round(profile.buffer_s * profile.sample_rate_hz)
        self._written = 0  # samples
        self._moved_s = 0.0
        self._task: Any = None
        self._monitor: DaqMonitor | None = None
        self._enable: Any = None
        self._watchdog: Any = None
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        super().__init__(profile, f"daq:channel={profile.channel}")
        try:
            self._open()
        except self._daq.errors.Error as error:
            self._shut()
            raise _refusal(self.name, error) from error
        except BaseException:
            self._shut()
            raise
        self._thread = threading.Thread(target=self._feed, name="firmware_io daq", daemon=True)
        self._thread.start()
        self._hold()

    @property
    def latency_s(self) -> float:
        """Time that samples wait in the buffer, in seconds."""
        return self._profile.buffer_s

    def _open(self) -> None:
        """Start the watchdog, which a chassis requires first, and the output at 0 V."""
        constants, profile = self._daq.constants, self._profile
        card = _card(self._daq, profile.channel)
        if profile.watchdog is not None:
            self._watchdog = _watchdog(self._daq, card, profile)
            self._watchdog.start()
        self._task = self._daq.Task()
        full_v = profile.card_full_scale_v
        channel = self._task.ao_channels.add_ao_voltage_chan(
            profile.channel, min_val=-full_v, max_val=full_v
        )
        self._feed_watchdog()
        with suppress(self._daq.errors.DaqError):  # where the card can: when no task runs
            channel.ao_idle_output_behavior = constants.AOIdleOutputBehavior.ZERO_VOLTS
        if profile.trigger is not None:
            self._task.ao_channels.add_ao_voltage_chan(
                profile.trigger, min_val=0.0, max_val=_LINE_V
            )
        timing = {
            "sample_mode": constants.AcquisitionType.CONTINUOUS,
            "samps_per_chan": 2 * self._lead,
        }
        self._task.timing.cfg_samp_clk_timing(profile.sample_rate_hz, **timing)
        rate_hz = self._task.timing.samp_clk_rate
        if abs(rate_hz / profile.sample_rate_hz - 1.0) > _MOST_RATE_ERROR:
            raise DeviceError(
                f"{self.name} runs at {rate_hz:g} samples a second instead of "
                f"{profile.sample_rate_hz:g}; give a sample_rate_hz that divides its timebase."
            )
        # Without this the card would play the buffer again when the host is late.
        self._task.out_stream.regen_mode = constants.RegenerationMode.DONT_ALLOW_REGENERATION
        self._task.out_stream.output_buf_size = 2 * self._lead
        self._writer = self._daq.stream_writers.AnalogMultiChannelWriter(
            self._task.out_stream, auto_start=False
        )
        if profile.monitor is not None:
            read = self._daq.Task()
            self._monitor = DaqMonitor(read, full_v, 2 * self._lead)
            read.ai_channels.add_ai_voltage_chan(profile.monitor, min_val=-full_v, max_val=full_v)
            clock = f"/{card}/ao/SampleClock"
            timing["samps_per_chan"] = 20 * self._lead
            read.timing.cfg_samp_clk_timing(profile.sample_rate_hz, source=clock, **timing)
            read.start()
        self._feed_watchdog()
        self._write(self._lead)
        self._task.start()
        self._feed_watchdog()
        if profile.line_of_amplifier is not None:
            self._enable = self._daq.Task()
            self._enable.do_channels.add_do_chan(profile.line_of_amplifier)
            self._enable.write(True)
        self._moved_s = self._asked_s = time.monotonic()  # to start it all may take a while

    def _feed(self) -> None:
        """Keep the buffer filled, by the card's clock, until the link closes; a thread's body."""
        raise_priority()
        try:
            while not self._closing.wait(self._profile.buffer_s / 6):
                self._step()
        # The output must end whatever the library raises.
        except Exception as error:
            self._fail(str(error).replace("\n", " "))
            self._silence()

    def _step(self) -> None:
        """Write as many samples as the card has played; check that it plays these samples."""
        played = self._task.out_stream.total_samp_per_chan_generated
        count = self._lead - (self._written - played)
        now_s = time.monotonic()
        if count > 0:
            self._moved_s = now_s
            self._write(count)
        elif now_s - self._moved_s > STILL_S:
            raise DeviceError("its sample clock stands")
        if self._monitor is not None:
            self._monitor.compare()
        self._feed_watchdog()

    def _feed_watchdog(self) -> None:
        if self._watchdog is not None:
            if self._watchdog.expired:
                raise DeviceError("its watchdog has expired, so the host was too late")
            self._watchdog.reset_timer()

    def _write(self, count: int) -> None:
        codes, line = self._next(count)
        volts = codes.astype(np.float64) * (self._profile.card_full_scale_v / FULL_SCALE_CODE)
        rows = [volts, line * _LINE_V] if self._profile.has_line else [volts]
        self._writer.write_many_sample(np.array(rows), timeout=WATCHDOG_S)
        self._written += count
        if self._monitor is not None:
            self._monitor.take(volts)

    def _end(self, plays_on: bool) -> None:
        """End the thread, and the output at 0 V."""
        self._closing.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()
        self._silence()

    def _silence(self) -> None:
        """Write 0 V without a clock; the watchdog ends last, and expires if the write failed."""
        if self._monitor is not None:
            self._close_task(self._monitor.task)
        task, self._task, self._monitor = self._task, None, None
        self._close_task(task)
        ends_at_zero = task is None or self._write_zero()
        if self._enable is not None:
            with suppress(self._daq.errors.Error):
                self._enable.write(False)
        watchdog, self._watchdog = self._watchdog, None
        if watchdog is not None:
            if not ends_at_zero:
                time.sleep(2 * WATCHDOG_S)
            self._close_task(watchdog)
        enable, self._enable = self._enable, None
        self._close_task(enable)

    def _write_zero(self) -> bool:
        """Write 0 V to the output at once; return whether the card took it."""
        full_v = self._profile.card_full_scale_v
        with suppress(self._daq.errors.Error), self._daq.Task() as rest:
            rest.ao_channels.add_ao_voltage_chan(
                self._profile.channel, min_val=-full_v, max_val=full_v
            )
            rest.write(0.0)
            return True
        return False

    def _close_task(self, task: Any) -> None:
        if task is not None:
            with suppress(self._daq.errors.Error):
                task.stop()
            with suppress(self._daq.errors.Error):
                task.close()


def _card(daq: Any, channel: str) -> str:
    """Return the name of the part with clock and watchdog: the card, or the chassis of a module."""
    name, chassis = channel.partition("/")[0], ""
    with suppress(daq.errors.DaqError):  # no module of a chassis
        chassis = daq.system.Device(name).compact_daq_chassis_device.name
    return chassis or name


def _watchdog(daq: Any, card: str, profile: DaqProfile) -> Any:
    """Return the card's watchdog, which takes the output or the amplifier's line to 0."""
    types, constants, line = daq.types, daq.constants, profile.line_of_amplifier
    watchdog = daq.system.WatchdogTask(card, timeout=WATCHDOG_S)
    try:
        with suppress(daq.errors.DaqError):  # of an earlier session; it would lock the output
            watchdog.clear_expiration()
        if line is None:
            volts = constants.WatchdogAOExpirState.VOLTAGE
            watchdog.cfg_watchdog_ao_expir_states(
                [types.AOExpirationState(profile.channel, 0.0, volts)]
            )
        else:
            watchdog.cfg_watchdog_do_expir_states(
                [types.DOExpirationState(line, constants.Level.LOW)]
            )
    except daq.errors.DaqError as error:
        watchdog.close()
        text = str(error).replace("\n", " ")
        raise DeviceError(
            f"{card} has no such watchdog ({text}); give the digital line that enables the "
            "amplifier as watchdog=, or use an interlock that works without the host, and state it "
            "by interlock=."
        ) from error
    return watchdog


def nidaqmx_module() -> Any:
    """Import the package of National Instruments."""
    with from_extra("daq"):
        daq = import_module("nidaqmx")
        for part in ("constants", "errors", "stream_writers", "system", "types"):
            import_module(f"nidaqmx.{part}")
    return daq


def _refusal(name: str, error: Exception) -> DeviceError:
    code, text = getattr(error, "error_code", None), str(error).replace("\n", " ")
    for kind, why in _NOT_INSTALLED.items():
        if type(error).__name__ == kind:
            return DeviceError(f"{why} from National Instruments: {text}")
    if code in _RESERVED:
        return DeviceBusyError(f"{name} is in use by another program or task: {text}")
    if code in _UNKNOWN:
        return DeviceNotFoundError(f"{name} is not there: {text}; `haptix devices` lists outputs.")
    return DeviceError(f"{name} cannot be opened: {text}; correct the address.")


def _open(profile: str | None = None, **values: Any) -> DaqLink:
    known = {} if profile is None else read_rig_profile(profile, DaqProfile)
    return DaqLink(DaqProfile(**{**known, **values}))


def _search() -> tuple[str, list[DeviceInfo]]:
    daq = nidaqmx_module()
    system = daq.system.System.local()
    version = system.driver_version
    note = "Say amplifier_gain=, and watchdog=yes or interlock=; unproven on hardware."
    devices = [
        DeviceInfo(f"daq:channel={output.name}", "daq", f"{device.product_type}", True, note)
        for device in system.devices
        for output in device.ao_physical_chans
    ]
    named = f"{version.major_version}.{version.minor_version}"
    return f"nidaqmx {daq.__version__}, NI-DAQmx {named}", devices


SCHEME = Scheme(
    _open,
    {
        "channel": str,
        "profile": str,
        "dac_full_scale_v": number,
        "amplifier_gain": number,
        "ceiling_v": number,
        "watchdog": str,
        "interlock": str,
        "trigger": str,
        "monitor": str,
        "buffer_s": number,
    },
    makes_rate=True,
    bus=Bus(_search, "pip install 'haptix-electrovibration[daq]', and NI-DAQmx for the card"),
)
