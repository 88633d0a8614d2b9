"""Checks of what goes wrong on the way: the error, 0 V in time, and recovery by reopening."""

import os
import threading
import time
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from firmware_io import (
    DeviceDisconnectedError,
    DeviceError,
    DeviceFaultError,
    ProtocolError,
    volts_to_codes,
)
from firmware_io.firmware.core import Output
from firmware_io.protocol import DeviceState
from tests.devices.guest.plugged import PluggedBoard, wait_for
from tests.devices.guest.ways import HID, HIDRAW, USB, WAYS, check, require, same, wave

_RATE_HZ = 16_000
#: The longest that there is; the board keeps to it by its own clock.
_WATCHDOG_S = 0.16
_BLOCK = 249  # 9 reports
_WHOLE_BLOCKS = 2
_BLOCKS = 6
_UNPLUGS = int(os.environ.get("HAPTIX_UNPLUGS", "2"))
_SETTINGS = {"mode": "waveform", "sample_rate_hz": _RATE_HZ, "watchdog_s": _WATCHDOG_S}


@dataclass(frozen=True)
class _Fault:
    happens: str
    error: type | tuple[type, ...]
    ways: tuple = WAYS
    needs_replug: bool = False
    is_answer: bool = False


# The host waits for an answer as long as the driver waits for samples: either may be the first.
_NO_ANSWER = (DeviceDisconnectedError, DeviceFaultError)
_FAULTS = {
    "unplugged_in_mid_stream": _Fault("disconnect", DeviceDisconnectedError, needs_replug=True),
    "lost": _Fault("lose", DeviceFaultError),
    "corrupt": _Fault("corrupt", DeviceFaultError),
    "cut_in_silence": _Fault("cut", DeviceFaultError),
    "short_packet": _Fault("short-write", DeviceDisconnectedError),
    "repeated": _Fault("repeat", DeviceFaultError),
    "held_back_until_the_next": _Fault("delay", type(None)),
    "noise_between": _Fault("noise", DeviceFaultError),
    "timed_out": _Fault("time-out", DeviceDisconnectedError),
    "stalled": _Fault("halt", ProtocolError, (USB,)),
    # Nothing but a replug clears the halt of an endpoint for reports: hidapi cannot.
    "stalled_for_good": _Fault("halt", DeviceDisconnectedError, (HIDRAW, HID), needs_replug=True),
    "answer_lost": _Fault("lose-answer", _NO_ANSWER, is_answer=True),
    "answer_corrupt": _Fault("corrupt-answer", _NO_ANSWER, is_answer=True),
    "mute": _Fault("mute", DeviceDisconnectedError, needs_replug=True, is_answer=True),
}


def _register(name, fault):
    def a_fault(way):
        return _survive(way, fault)

    a_fault.__name__ = name
    check(*fault.ways)(a_fault)


for _name, _of in _FAULTS.items():
    _register(_name, _of)


def _survive(way, fault):
    volts = wave(_BLOCKS * _BLOCK, _RATE_HZ)
    codes = volts_to_codes(volts, 250.0)
    with _board() as board:
        device = way.open(**_SETTINGS)
        began_s = time.monotonic()
        error = _stream_into(device, board, way, fault, volts)
        took_s = time.monotonic() - began_s
        expected = fault.error if isinstance(fault.error, tuple) else (fault.error,)
        require(type(error) in expected, f"{type(error).__name__}: {error}")
        with suppress(DeviceError):  # of a lost device, that STOP could not be delivered
            device.close()
        _is_at_rest(board)
        what_was_played = _streamed(board)
        same(what_was_played, codes[: what_was_played.size])

        if fault.needs_replug:
            board.pull_out()
            board.plug_in()
        board.wait_until_there()
        _plays_again(board, way, volts, codes)
    require(threading.active_count() == 1, threading.enumerate())
    return {"error": str(error), "seen_after_s": took_s, "samples_before": what_was_played.size}


def _stream_into(device, board, way, fault, volts):
    """Write blocks, with a fault behind the first of them; return the error."""
    try:
        with device:
            for number in range(_BLOCKS):
                if number == _WHOLE_BLOCKS:
                    # Here the driver has room, so that the next transfers are those of samples.
                    # Of reports, it happens to the middle one of a frame.
                    is_report = way is not USB and not fault.is_answer
                    board.inject(way.endpoint, fault.happens, 4 if is_report else 0)
                device.write(volts[number * _BLOCK : (number + 1) * _BLOCK])
    except DeviceError as error:
        return error
    return None


def _board():
    return PluggedBoard(
        sample_rate_hz=_RATE_HZ, rates_hz=(_RATE_HZ,), max_watchdog_s=_WATCHDOG_S, pace="real"
    )


def _is_at_rest(board):
    """The output is at 0 V, and no sample stood longer than the watchdog time before it was."""
    wait_for(lambda: board.about()[0].state is DeviceState.IDLE, 2 * _WATCHDOG_S + 5.0)
    codes, what = board.output()
    require(codes[-1] == 0, f"the output is at code {codes[-1]}")
    edges = np.flatnonzero(np.diff(np.r_[False, what == Output.HELD, False].astype(int)))
    held = int(np.max(edges[1::2] - edges[::2], initial=0))
    require(held <= _WATCHDOG_S * _RATE_HZ, f"a sample stood for {held} samples")


def _streamed(board):
    codes, what = board.output()
    return codes[what == Output.STREAM]


def _plays_again(board, way, volts, codes):
    before = _streamed(board).size
    with way.open(**_SETTINGS) as device:
        device.write(volts)
        # A stop waits for what is queued by the host's clock, which the board's may fall behind.
        wait_for(lambda: _streamed(board).size >= before + codes.size)
    device.close()
    same(_streamed(board)[before:], codes)
    _is_at_rest(board)


@check(*WAYS)
def unplugged_at_rest_and_replugged(way):
    """An armed device that has played nothing: the next write tells, and so does every other."""
    volts = wave(_BLOCK, _RATE_HZ)
    codes = volts_to_codes(volts, 250.0)
    with _board() as board:
        device = way.open(**_SETTINGS)
        device.arm()
        board.pull_out()
        errors = []
        for action in (lambda: device.write(volts), device.stop, device.arm, device.close):
            try:
                action()
            except DeviceDisconnectedError as error:
                errors.append(str(error))
        require(len(errors) == 4, errors)
        with suppress(DeviceDisconnectedError):
            device.close()
        began_s = time.monotonic()
        board.plug_in()
        found_s = time.monotonic() - began_s
        _plays_again(board, way, volts, codes)
    return {"found_again_after_s": found_s}


@check(*WAYS)
def unplugged_again_and_again(way):
    """In mid-stream each time: 0 V in the watchdog time, played again in the same process."""
    volts = wave(_BLOCKS * _BLOCK, _RATE_HZ)
    codes = volts_to_codes(volts, 250.0)
    fault, found_s, files = _FAULTS["unplugged_in_mid_stream"], [], []
    with _board() as board:
        for _ in range(_UNPLUGS):
            device = way.open(**_SETTINGS)
            error = _stream_into(device, board, way, fault, volts)
            require(type(error) is DeviceDisconnectedError, repr(error))
            with suppress(DeviceDisconnectedError):
                device.close()
            _is_at_rest(board)
            board.pull_out()
            began_s = time.monotonic()
            board.plug_in()
            _plays_again(board, way, volts[-_BLOCK:], codes[-_BLOCK:])
            found_s.append(time.monotonic() - began_s)
            files.append(len(os.listdir("/proc/self/fd")))  # noqa: PTH208
        require(files[-1] <= files[0], f"open files grow: {files}")
    require(threading.active_count() == 1, threading.enumerate())
    return {"times": _UNPLUGS, "played_again_after_s": max(found_s), "files": files[-1]}


@check(*WAYS)
def a_host_that_falls_silent(way):
    """The board starves: at 0 V within the watchdog time, and the host is told by its next call."""
    volts = wave(_BLOCK, _RATE_HZ)
    with _board() as board:
        device = way.open(**{**_SETTINGS, "watchdog_s": 0.1, "lead_s": 0.02})
        device.arm()
        device.write(volts[:80])  # one frame, whichever way
        wait_for(lambda: board.about()[0].state is DeviceState.IDLE)
        codes, what = board.output()
        require(codes[-1] == 0, "not at 0 V")
        # Both times count from the one frame: the lead to the first sample, the watchdog to 0 V.
        alive = np.flatnonzero(what != Output.IDLE)
        lasted_s = (alive[-1] - alive[0] + 1) / _RATE_HZ
        require(lasted_s <= 0.1 - 0.02 + 1 / _RATE_HZ, f"the output lasted {lasted_s:.4g} s")
        error = None
        try:
            device.write(volts)
            device.stop()
        except DeviceError as raised:
            error = raised
        require(type(error) is DeviceFaultError, repr(error))
        require("starved" in str(error), error)
        device.close()
        _plays_again(
            board, way, wave(_BLOCK, _RATE_HZ), volts_to_codes(wave(_BLOCK, _RATE_HZ), 250.0)
        )
    return {"output_lasted_s": lasted_s}


@check(*WAYS)
def a_device_that_is_forgotten(way):
    """Without a stop or a close, collecting the object brings the output to 0 V and lets go."""
    volts = wave(_BLOCK, _RATE_HZ)
    with _board() as board:
        device = way.open(**_SETTINGS)
        device.arm()
        device.write(volts[: _BLOCK // 2])
        del device
        _is_at_rest(board)
        board.wait_until_there()
        _plays_again(board, way, volts, volts_to_codes(volts, 250.0))
    return {}
