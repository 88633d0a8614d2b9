"""The ways to a board, the registry of checks, and what every check needs."""

import multiprocessing
import os
from dataclasses import dataclass

import numpy as np

from tests.devices.guest.descriptors import BULK_ENDPOINT, HID_ENDPOINT


@dataclass(frozen=True)
class Way:
    """One of the stacks between a device object and the board."""

    name: str
    address: str
    endpoint: int

    def open(self, **settings):
        """Open the board with more settings in its address."""
        from firmware_io import open_device

        more = ",".join(f"{key}={value}" for key, value in settings.items())
        return open_device(self.address + ("," if more and "=" in self.address else "") + more)


USB = Way("usb", "usb:", BULK_ENDPOINT)
HIDRAW = Way("hidraw", "hid:backend=hidraw", HID_ENDPOINT)
HID = Way("hid-libusb", "hid:backend=hid", HID_ENDPOINT)
WAYS = (USB, HIDRAW, HID)

#: Every check, by name: what takes no arguments and returns a dict of figures, or raises.
CHECKS = {}


def check(*ways):
    """Register a function as a check, or as one for each of the ways, which it is given."""

    def register(function):
        name = function.__name__
        if not ways:
            CHECKS[name] = function
        for way in ways:
            CHECKS[f"{name}[{way.name}]"] = lambda way=way: function(way)
        return function

    return register


class Elsewhere:
    """A function in another process, forked before this one has touched any library of USB.

    Parameters
    ----------
    function : callable
        Its answer, or the exception that it raised, comes back from each `run`.
    user_id : int, optional
        Of whom to become first.
    before : callable, optional
        What to do before that.
    """

    def __init__(self, function, user_id=None, before=None):
        self._commands, theirs = multiprocessing.Pipe()
        self._process = os.fork()
        if self._process == 0:
            self._commands.close()
            try:
                theirs.recv()
                if before is not None:
                    before()
                if user_id is not None:
                    os.setgroups([])
                    os.setgid(user_id)
                    os.setuid(user_id)
                while True:
                    theirs.send(_answer_of(function))
                    theirs.recv()
            finally:
                os._exit(0)  # whoever waits for an answer finds the end of the pipe
        theirs.close()

    def run(self):
        """Let it run, and return its answer."""
        self._commands.send(None)
        return self._commands.recv()

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self._commands.close()
        os.waitpid(self._process, 0)


def _answer_of(function):
    try:
        return function()
    except BaseException as error:
        return error


def error_of(function):
    """Return the exception that a function raises; None if it raises none."""
    try:
        function()
    except Exception as error:
        return error
    return None


def wave(samples, rate_hz, seed=1):
    """A waveform whose every stretch is its own, that ends in 0 V: two tones and noise.

    Gentle enough for every limit: 190 V at most, and below 20 kHz.
    """
    t = np.arange(samples) / rate_hz
    noise = np.random.default_rng(seed).uniform(-1.0, 1.0, samples)
    volts = (
        120.0 * np.sin(2 * np.pi * 0.0047 * rate_hz * t)
        + 50.0 * np.sin(2 * np.pi * 0.041 * rate_hz * t)
        + 15.0 * noise
    )
    volts[-2:] = 0.0
    ramp = min(200, samples // 4)
    volts[:ramp] *= np.arange(ramp) / ramp
    volts[-2 - ramp : -2] *= np.arange(ramp, 0, -1) / ramp
    return volts


def envelope(samples, rate_hz, seed=2):
    """Amplitudes between 0 and 170 V whose every stretch is its own, from 0 to 0.

    With their changes they keep the limit of the current on a carrier of 4 kHz.
    """
    t = np.arange(samples) / rate_hz
    noise = np.random.default_rng(seed).uniform(-1.0, 1.0, samples)
    volts = 95.0 + 62.0 * np.sin(2 * np.pi * 31.0 * t) + 9.0 * noise
    ramp = min(200, samples // 4)
    volts[:ramp] *= np.arange(ramp) / ramp
    volts[-2 - ramp : -2] *= np.arange(ramp, 0, -1) / ramp
    volts[-2:] = 0.0
    return volts


def same(got, wanted):
    """Compare every sample."""
    np.testing.assert_array_equal(got, wanted)


def require(is_true, *why):
    """Complain, with what there is to know, if something is not true."""
    if not is_true:
        raise AssertionError(" ".join(map(str, why)))
