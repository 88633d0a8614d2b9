"""JACK's dummy server with a client that hears everything, and a program that plays into it."""

import json
import os
import shutil
import subprocess
import sys
import time
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent


def missing():
    """What is missing for these tests; empty if nothing is."""
    things = {
        "jackd (apt install jackd2)": shutil.which("jackd"),
        "JACK-Client (pip install JACK-Client)": find_spec("jack"),
        "sounddevice": find_spec("sounddevice"),
    }
    return ", ".join(thing for thing, found in things.items() if not found)


class Hearing:
    """What the capturing client heard, once the session has ended."""

    environment: dict[str, str]
    samples: np.ndarray
    told: dict[str, float]


@contextmanager
def jack_session(folder, client_timeout_ms=5000):
    """Run a server and a capturing client called "cap"; programs get its `environment`.

    The server waits `client_timeout_ms` for a client in each of some ten to twenty cycles, also for
    one that is dead.
    """
    hearing = Hearing()
    hearing.environment = {
        **os.environ,
        "JACK_DEFAULT_SERVER": "haptix",  # a killed one's place is taken by the next of its name
        "JACK_NO_AUDIO_RESERVATION": "1",
        "PYTHONPATH": str(HERE.parents[1]),
    }
    name = hearing.environment["JACK_DEFAULT_SERVER"]
    # Synchronous (-S): a client that is held up delays the cycle. Otherwise JACK leaves the client
    # out of it, and on a machine that stalls the samples of whole cycles are not heard.
    command = ["jackd", "-R", "-P", "60", "-S", "-t", str(client_timeout_ms), "-n", name]
    command += ["-d", "dummy", "-r", "48000", "-p", "480", "-C", "0", "-P", "2"]
    capture = None
    with (folder / "jackd.log").open("w") as log:
        server = subprocess.Popen(
            command, env=hearing.environment, stdout=log, stderr=subprocess.STDOUT
        )
        try:
            capture = _start_capture(folder, hearing.environment, server)
            yield hearing
            capture.communicate(timeout=600)
        finally:
            for process in (capture, server):
                if process is not None and process.poll() is None:
                    process.terminate()
                    process.wait(10)
    hearing.samples = np.load(folder / "heard.npy")
    hearing.told = json.loads((folder / "capture.json").read_text())


def _start_capture(folder, environment, server):
    """Start the capturing client as soon as the server takes it."""
    for _ in range(50):
        assert server.poll() is None, (folder / "jackd.log").read_text()
        capture = subprocess.Popen(
            [sys.executable, str(HERE / "jack_capture.py"), str(folder)],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        if capture.stdout.readline() == "ready\n":
            return capture
        capture.wait(10)
        time.sleep(0.1)
    raise AssertionError((folder / "jackd.log").read_text())
