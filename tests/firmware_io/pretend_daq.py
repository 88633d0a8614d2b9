"""NI-DAQmx without a card: what haptix calls is held to the real package's signatures.

Constants, types and errors are nidaqmx's own; its classes are stood in for. Every call is bound to
the signature of the real method, so that a wrong name or argument fails as it would there. How a
card behaves is from NI's documents, not from hardware.
"""

import inspect
from functools import wraps
from types import ModuleType
from typing import Any

import nidaqmx
import nidaqmx.constants
import nidaqmx.errors
import nidaqmx.stream_writers
import nidaqmx.system
import nidaqmx.types
import numpy as np
from nidaqmx.constants import Level, WatchdogAOExpirState
from nidaqmx.system.watchdog import WatchdogTask
from nidaqmx.task._in_stream import InStream
from nidaqmx.task._out_stream import OutStream
from nidaqmx.task._timing import Timing
from nidaqmx.task.channels import AOChannel
from nidaqmx.task.collections import AIChannelCollection, AOChannelCollection, DOChannelCollection

__all__ = ["Card", "Level", "WatchdogAOExpirState", "pretend"]
PERIOD = 64  # samples that the card plays between two questions


def like(real):
    """Bind the calls of a method to the signature of a real one."""
    signature = inspect.signature(real)

    def decorate(method):
        @wraps(method)
        def call(self, *arguments, **named):
            bound = signature.bind(self, *arguments, **named)
            bound.apply_defaults()
            return method(self, **dict(list(bound.arguments.items())[1:]))

        return call

    return decorate


def reads(real: Any, *names: str):
    """Check that the attributes that a stand-in has are properties of the real class."""

    def decorate(pretended):
        for name in names:
            assert isinstance(inspect.getattr_static(real, name), property), name
        return pretended

    return decorate


class Card:
    """One card: its outputs, its clock, its watchdog, and what has gone wrong with it."""

    def __init__(self):
        self.heard = {}  # volts by channel
        self.range_v = {}
        self.lines = {}
        self.refusals = {}  # error codes by the name of a call
        self.rate_error = 0.0
        self.monitor_gain = 1.0
        self.stands = self.is_late = False
        self.watchdogs = []
        self.open_tasks = []
        self.chassis = ""

    def refuse(self, call):
        if call in self.refusals:
            raise nidaqmx.errors.DaqError("refused\nfor a reason", self.refusals[call])

    def volts(self, channel="Dev1/ao0"):
        return np.array(self.heard.get(channel, []))


class PretendChannels:
    """`ao_channels`, `ai_channels` and `do_channels` of a task."""

    def __init__(self, task):
        self.task = task

    @like(AOChannelCollection.add_ao_voltage_chan)
    def add_ao_voltage_chan(self, physical_channel, min_val, max_val, **_):
        self.task.card.refuse("add_ao_voltage_chan")
        self.task.outputs.append(physical_channel)
        self.task.card.range_v[physical_channel] = (min_val, max_val)
        return reads(AOChannel, "ao_idle_output_behavior")(PretendChannels(self.task))

    @like(AIChannelCollection.add_ai_voltage_chan)
    def add_ai_voltage_chan(self, physical_channel, **_):
        self.task.inputs.append(physical_channel)

    @like(DOChannelCollection.add_do_chan)
    def add_do_chan(self, lines, **_):
        self.task.lines.append(lines)


@reads(Timing, "samp_clk_rate")
class PretendTiming:
    def __init__(self, card):
        self.card = card

    @like(Timing.cfg_samp_clk_timing)
    def cfg_samp_clk_timing(self, rate, source, sample_mode, **_):
        assert sample_mode is nidaqmx.constants.AcquisitionType.CONTINUOUS
        assert source in ("", f"/{self.card.chassis or 'Dev1'}/ao/SampleClock")
        self.samp_clk_rate = rate * (1.0 + self.card.rate_error)


@reads(OutStream, "total_samp_per_chan_generated", "regen_mode", "output_buf_size")
@reads(InStream, "avail_samp_per_chan")
class PretendStream:
    """A task's buffer: the card plays a period whenever it is asked how far it is."""

    regen_mode: Any = None
    output_buf_size = 0

    def __init__(self, task):
        self.task, self.pending, self.played = task, [], []

    @property
    def total_samp_per_chan_generated(self):
        card = self.task.card
        card.refuse("generated")
        count = 0 if card.stands else PERIOD
        assert self.regen_mode is nidaqmx.constants.RegenerationMode.DONT_ALLOW_REGENERATION
        if card.is_late or count > len(self.pending):
            raise nidaqmx.errors.DaqError("stopped to prevent regeneration", -200290)
        assert len(self.pending) <= self.output_buf_size
        played, self.pending = self.pending[:count], self.pending[count:]
        for sample in played:
            for channel, volts in zip(self.task.outputs, sample, strict=True):
                card.heard.setdefault(channel, []).append(volts)
        self.played += [sample[0] for sample in played]
        return len(self.played)

    @property
    def avail_samp_per_chan(self):
        return len(self.source) - self.taken

    @property
    def source(self):
        return next(t for t in self.task.card.open_tasks if t.outputs).out_stream.played

    taken = 0


class PretendTask:
    card: Card

    @like(nidaqmx.Task.__init__)
    def __init__(self, **_):
        self.card.refuse("Task")
        self.outputs, self.inputs, self.lines = [], [], []
        self.ao_channels = self.ai_channels = self.do_channels = PretendChannels(self)
        self.timing = PretendTiming(self.card)
        self.out_stream = self.in_stream = PretendStream(self)
        self.is_running = False
        self.card.open_tasks.append(self)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    @like(nidaqmx.Task.start)
    def start(self):
        self.is_running = True

    @like(nidaqmx.Task.stop)
    def stop(self):
        self.is_running = False

    @like(nidaqmx.Task.close)
    def close(self):
        self.card.open_tasks.remove(self)

    @like(nidaqmx.Task.write)
    def write(self, data, **_):
        self.card.refuse("write")
        for line in self.lines:
            self.card.lines[line] = data
        for output in self.outputs:
            self.card.heard.setdefault(output, []).append(data)

    @like(nidaqmx.Task.read)
    def read(self, number_of_samples_per_channel, **_):
        stream = self.in_stream
        first, stream.taken = stream.taken, stream.taken + number_of_samples_per_channel
        # An edge reads what the output had before it.
        before = [0.0, *stream.source][first : stream.taken]
        return [self.card.monitor_gain * volts for volts in before]


class PretendWriter:
    @like(nidaqmx.stream_writers.AnalogMultiChannelWriter.__init__)
    def __init__(self, task_out_stream, **_):
        self.stream = task_out_stream

    @like(nidaqmx.stream_writers.AnalogMultiChannelWriter.write_many_sample)
    def write_many_sample(self, data, **_):
        task = self.stream.task
        task.card.refuse("write_many_sample")
        assert data.dtype == np.float64 and data.shape[0] == len(task.outputs)
        for volts, output in zip(data, task.outputs, strict=True):
            low, high = task.card.range_v[output]
            assert np.all((volts >= low) & (volts <= high))
        self.stream.pending += data.T.tolist()


@reads(WatchdogTask, "expired")
class PretendWatchdog:
    card: Card

    @like(WatchdogTask.__init__)
    def __init__(self, device_name, timeout, **_):
        assert not [task for task in self.card.open_tasks if task.is_running]
        self.device, self.timeout, self.resets = device_name, timeout, 0
        self.states, self.is_running, self.is_closed, self.expired = [], False, False, False
        self.card.watchdogs.append(self)

    @like(WatchdogTask.clear_expiration)
    def clear_expiration(self):
        self.card.refuse("clear_expiration")

    @like(WatchdogTask.cfg_watchdog_ao_expir_states)
    def cfg_watchdog_ao_expir_states(self, expiration_states):
        self.card.refuse("cfg_watchdog_ao_expir_states")
        self.states += expiration_states

    @like(WatchdogTask.cfg_watchdog_do_expir_states)
    def cfg_watchdog_do_expir_states(self, expiration_states):
        self.states += expiration_states

    @like(WatchdogTask.start)
    def start(self):
        self.is_running = True

    @like(WatchdogTask.stop)
    def stop(self):
        self.is_running = False

    @like(WatchdogTask.reset_timer)
    def reset_timer(self):
        assert self.is_running
        self.resets += 1

    @like(WatchdogTask.close)
    def close(self):
        self.is_closed = True


def pretend(card: Card) -> dict[str, ModuleType]:
    """Return nidaqmx with a card, by the names of its modules."""
    system: Any = ModuleType("nidaqmx.system")
    writers: Any = ModuleType("nidaqmx.stream_writers")
    module: Any = ModuleType("nidaqmx")
    system.WatchdogTask = type("WatchdogTask", (PretendWatchdog,), {"card": card})
    system.Device = lambda name: Found(card, name)
    system.System = Computer(card)
    writers.AnalogMultiChannelWriter = PretendWriter
    module.Task = type("Task", (PretendTask,), {"card": card})
    module.__version__ = nidaqmx.__version__
    module.system, module.stream_writers = system, writers
    for part in ("constants", "errors", "types"):
        setattr(module, part, getattr(nidaqmx, part))
    assert isinstance(inspect.getattr_static(nidaqmx.system.System, "local"), staticmethod)
    return {"nidaqmx": module, "nidaqmx.system": system, "nidaqmx.stream_writers": writers}


@reads(nidaqmx.system.System, "driver_version", "devices")
class Computer:
    """The system: one card with two outputs."""

    driver_version = nidaqmx.types.DriverVersion(24, 5, 0)

    def __init__(self, card):
        self.devices = [Found(card, "Dev1")]

    def local(self):
        return self


@reads(nidaqmx.system.Device, "product_type", "ao_physical_chans", "compact_daq_chassis_device")
class Found:
    product_type = "PCIe-6363"

    def __init__(self, card, name):
        self.card, self.name = card, name
        self.ao_physical_chans = [type("Chan", (), {"name": f"{name}/ao{n}"}) for n in (0, 1)]

    @property
    def compact_daq_chassis_device(self):
        if not self.card.chassis:
            raise nidaqmx.errors.DaqError("not applicable", -200197)
        return Found(self.card, self.card.chassis)
