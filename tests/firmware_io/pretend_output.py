"""An output that a thread plays, for a process of its own; it writes what it plays to a file."""

import threading
import time

import numpy as np

from firmware_io.device_errors import DeviceBusyError
from firmware_io.links import hosted
from firmware_io.links.audio import AudioProfile
from firmware_io.links.hosted import HostedLink
from firmware_io.links.own_process import serve_link

BLOCK = 480


class PretendLink(HostedLink):
    """Plays by the clock of this machine; stands for good after `stands_after_s`."""

    def __init__(self, file, stands_after_s=1e9):
        super().__init__(AudioProfile(full_scale_v=200.0), f"pretend:{file}")
        self.file, self.stands_after_s = open(file, "wb"), stands_after_s  # noqa: SIM115, PTH123
        self.ends = threading.Event()
        self.thread = threading.Thread(target=self.play, daemon=True)
        self.thread.start()
        self._hold()

    @property
    def latency_s(self):
        return 0.01

    def play(self):
        began_s, played = time.monotonic(), 0
        while not self.ends.wait(0.002):
            due_s = min(time.monotonic() - began_s, self.stands_after_s)
            while played < due_s * 48_000 and not self.ends.is_set():
                codes, _ = self._next(BLOCK)
                played += BLOCK
                self.file.write(codes.tobytes())
                self.file.flush()

    def _end(self, plays_on):
        self.ends.set()
        self.thread.join()


def open_pretended(file, busy=False, prints=False, **values):
    hosted.HOLD_S = 0.01
    if "stands_after_s" not in values:  # however late a busy machine lets it play
        hosted.STILL_S = hosted.HOLD_EXTRA_S = 300.0
    if prints:
        print("a library prints this")  # noqa: T201
    if busy:
        raise DeviceBusyError("another program plays")
    return PretendLink(file, **values)


def serve():
    serve_link(open_pretended)


def says_nothing():
    """Be a process whose library has aborted it."""


def tell():
    print([1, 2])  # noqa: T201


def heard(file):
    """Volts of a file."""
    return np.fromfile(file, np.int16) / 32767 * 200.0
