"""Checks of the thread that plays without the interpreter, by libusb's own calls and hidraw."""

import threading
import time
from contextlib import suppress

import numpy as np

from firmware_io import DeviceDisconnectedError, Playback, volts_to_codes
from firmware_io.own_thread import CompiledSource, OwnThread, compiled
from firmware_io.reviser import PlaybackStats
from tests.devices.guest.checks_faults import _SETTINGS, _board, _is_at_rest, _streamed
from tests.devices.guest.plugged import wait_for
from tests.devices.guest.ways import HIDRAW, USB, check, require, same, wave

_RATE_HZ = _SETTINGS["sample_rate_hz"]
_SECONDS = 20.0


def _source(volts):
    """A source whose functions are Python's: what is played counts here, not when."""
    ffi, _ = compiled()
    types = dict(ffi.typeof("hx_source").fields)

    def window(_of, first, count, _at_s, _is_revision, out):
        ffi.memmove(out, np.ascontiguousarray(volts[first : first + count]), 8 * count)

    makes = {"window": window, "is_live": lambda _of: 0}
    kept = [
        ffi.callback(types[name].type, makes.get(name, lambda *_: None))
        for name in ("window", "settle", "played", "report", "is_live")
    ]
    return CompiledSource(4, 0, tuple(int(ffi.cast("uintptr_t", k)) for k in kept), kept)


def _play(way, board, source, codes, is_pulled):
    """Play for half a second of the board, to the end or until its cable is pulled."""
    before, error = _streamed(board).size, None
    device = way.open(**_SETTINGS)
    require(not (why := OwnThread.why_not(device)), why)
    stats = PlaybackStats(horizon_s=0.1)
    own = OwnThread(device, source, stats)
    with (
        suppress(DeviceDisconnectedError),
        Playback(device, None, stats=stats, writer=lambda: own) as playback,
    ):
        wait_for(lambda: _streamed(board).size > before + _RATE_HZ / 2)
        if is_pulled:
            board.pull_out()
            try:
                for _ in range(100):
                    playback.raise_once()
                    time.sleep(0.05)
            except DeviceDisconnectedError as raised:
                error = raised
    require(is_pulled == (error is not None), error)
    with suppress(DeviceDisconnectedError):
        device.close()
    _is_at_rest(board)
    streamed = _streamed(board)[before:]
    same(streamed, codes[: streamed.size])
    return streamed.size, stats.underruns


@check(USB, HIDRAW)
def a_thread_of_its_own(way):
    """Every sample arrives, a pulled cable ends it at 0 V, and it plays again."""
    volts = wave(int(_SECONDS * _RATE_HZ), _RATE_HZ)
    codes, source = volts_to_codes(volts, 250.0), _source(volts)
    with _board() as board:
        pulled = _play(way, board, source, codes, True)
        board.plug_in()
        again = _play(way, board, source, codes, False)
    require(threading.active_count() == 1, threading.enumerate())
    return {"samples": (pulled[0], again[0]), "underruns": again[1]}
