"""A board in a process of its own, its cable, and its device nodes."""

import multiprocessing
import os
import sys
import time
import traceback
from contextlib import suppress
from pathlib import Path

from tests.devices.guest.board import Board


class PluggedBoard:
    """A board in a process of its own, connected while this is entered.

    Parameters
    ----------
    serial : str
    port : int
        Of the virtual host controller; each board has its own.
    echoes : bool
        Be another device that sends back whatever comes.
    driver
        Parameters of `firmware_io.MockDriver`.
    """

    def __init__(self, serial="BOARD001", port=0, echoes=False, **driver):
        self.serial = serial
        self._commands, theirs = multiprocessing.Pipe()
        self._process = os.fork()
        if self._process == 0:
            self._commands.close()
            try:
                Board(serial, port, echoes, **driver).serve(theirs)
            except BaseException:
                sys.stderr.write(traceback.format_exc())  # to the guest's console
                sys.stderr.flush()
            os._exit(0)
        theirs.close()

    def __getattr__(self, name):
        if name.startswith("_"):
            raise AttributeError(name)

        def call(*arguments):
            self._commands.send((name, arguments))
            is_good, answer = self._commands.recv()
            if not is_good:
                raise AssertionError(answer)
            return answer

        return call

    def __enter__(self):
        self.plug_in()
        return self

    def __exit__(self, *error):
        self._commands.close()
        os.waitpid(self._process, 0)

    def plug_in(self):
        """Connect it, and wait until kernel and udev have it."""
        self.plug()
        self.wait_until_there()

    def pull_out(self):
        """Pull its cable, and wait until kernel and udev have seen that."""
        self.unplug()
        wait_for(lambda: not any(nodes_of(self.serial)))

    def wait_until_there(self):
        """Wait for both of its device nodes, for USB and for hidraw."""
        wait_for(lambda: all(nodes_of(self.serial)))


def nodes_of(serial):
    """Return the device nodes, for USB and for hidraw, of the boards with a serial number.

    Of those only that udev has done with, under our own rule: programs see no others.
    """
    usb, hidraw = [], []
    for device in Path("/sys/bus/usb/devices").glob("*-*"):
        with suppress(OSError):
            if (device / "serial").read_text().strip() == serial:
                usb.append(device)
                hidraw += device.glob("*:*/*/hidraw/hidraw*")
    return [*_nodes(usb)], [*_nodes(hidraw)]


def _nodes(devices):
    for device in devices:
        with suppress(OSError):
            number = (device / "dev").read_text().strip()
            about = dict(line.split("=") for line in (device / "uevent").read_text().splitlines())
            if "G:uaccess" in Path(f"/run/udev/data/c{number}").read_text():
                yield Path("/dev") / about["DEVNAME"]


def wait_for(is_true, timeout_s=20.0):
    """Wait until something is true; the kernel enumerates in its own time."""
    end_s = time.monotonic() + timeout_s
    while not is_true():
        if time.monotonic() > end_s:
            raise TimeoutError("what was waited for did not come true")
        time.sleep(0.03)
