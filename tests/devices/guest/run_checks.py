"""Runs in the guest: every check in a process of its own; a line of JSON for each to /dev/ttyS1."""

import ctypes.util
import functools
import gc
import json
import os
import signal
import subprocess
import sys
import time
import traceback
from contextlib import suppress
from importlib import import_module
from pathlib import Path

import tests.devices.guest.checks_content
import tests.devices.guest.checks_faults
import tests.devices.guest.checks_opening
import tests.devices.guest.checks_own_thread
import tests.devices.guest.checks_pages
import tests.devices.guest.checks_revisions
import tests.devices.guest.checks_touchscreens  # noqa: F401
from firmware_io import open_device
from firmware_io.links import audio
from firmware_io.links.usb import udev_rule
from tests.devices.guest.plugged import wait_for
from tests.devices.guest.ways import CHECKS as CHECKS

_LIMIT_S = float(os.environ.get("CHECK_LIMIT_S", "60"))
_RESULTS = Path("/dev/ttyS1")


def start_udev():
    """Start udevd, with our own rule: libusb hears of what is plugged in from udevd alone."""
    rules = Path("/run/udev/rules.d")
    rules.mkdir(parents=True)
    (rules / "70-haptix.rules").write_text(udev_rule())
    subprocess.run([os.environ["UDEVD"], "--daemon"], check=True)
    wait_for(Path("/run/udev/control").exists)


def load_once():
    """Do once what each check needs, but load no library of USB: each takes a guest seconds."""
    # To look for a library takes ldconfig or a compiler, and for sound another Python.
    ctypes.util.find_library = functools.cache(ctypes.util.find_library)
    for library in ("usb-1.0", "nidaqmx"):
        ctypes.util.find_library(library)
    vars(audio)["ask_in_own_process"] = lambda *_: ("no sound in the guest", [])
    for module in ("usb.core", "usb.util", "usb.backend.libusb1", "serial", "nidaqmx.system"):
        import_module(module)
    open_device("mock:").close()  # with the declarations of the core and the entry points of links
    gc.freeze()  # else each check would copy the pages of all objects, to count them


def run(name):
    """Run one check; return its result, which a check that dies or hangs has as well."""
    here, there = os.pipe()
    began_s = time.monotonic()
    process = os.fork()
    if process == 0:
        os.setpgid(0, 0)
        os.close(here)
        try:
            result = {"passed": True, "figures": CHECKS[name]()}
        except BaseException:
            result = {"passed": False, "why": traceback.format_exc()}
        os.write(there, json.dumps(result, default=float).encode()[-60_000:])
        sys.stdout.flush()
        os._exit(0)
    os.close(there)
    signal.signal(signal.SIGALRM, lambda *_: os.killpg(process, signal.SIGKILL))
    signal.setitimer(signal.ITIMER_REAL, _LIMIT_S)
    status = os.waitpid(process, 0)[1]
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    with suppress(ProcessLookupError):
        os.killpg(process, signal.SIGKILL)  # boards that a failed check has left behind
    with os.fdopen(here, "rb") as pipe:
        said = pipe.read()
    took_s = time.monotonic() - began_s
    if said:
        result = json.loads(said)
    else:
        result = {"passed": False, "why": f"it ended with status {status} after {took_s:.1f} s"}
    return {"name": name, "seconds": round(took_s, 2), **result}


def main():
    """Run the checks that are named, or all of them."""
    start_udev()
    load_once()
    with _RESULTS.open("w") as results:
        for name in sys.argv[1:] or CHECKS:
            result = run(name)
            results.write(json.dumps(result) + "\n")
            results.flush()
            # On the console as well, for whoever watches it.
            mark = "passed" if result["passed"] else "FAILED"
            sys.stdout.write(f"{mark} {result['seconds']:6.2f} s  {name}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
