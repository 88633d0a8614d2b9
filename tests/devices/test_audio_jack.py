"""The audio link through the real PortAudio, into JACK's dummy driver: `make test-devices`.

Needs Debian's jackd2 and libportaudio2, and pip's JACK-Client.
"""

import json
import os
import shutil
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from firmware_io import volts_to_codes

pytestmark = pytest.mark.devices

HERE = Path(__file__).parent
SECONDS = 3.0
FULL_SCALE_V = 200.0
#: What the player may be held up without an underrun. It has real-time priority, as JACK has, so
#: that no other program holds it up, but the host of a virtual machine may. Its watchdog is 1 s.
LEAD_S = 0.4


def missing():
    """What is missing for these tests; empty if nothing is."""
    things = {
        "jackd (apt install jackd2)": shutil.which("jackd"),
        "JACK-Client (pip install JACK-Client)": find_spec("jack"),
        "sounddevice": find_spec("sounddevice"),
    }
    return ", ".join(thing for thing, found in things.items() if not found)


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """What was played, heard and told."""
    if missing():
        pytest.skip(f"missing: {missing()}")
    return _play(tmp_path_factory.mktemp("jack"))


def _play(folder):
    environment = {
        **os.environ,
        "JACK_DEFAULT_SERVER": f"haptix{os.getpid()}",
        "JACK_NO_AUDIO_RESERVATION": "1",
        "PYTHONPATH": str(HERE.parents[1]),
    }
    # Synchronous (-S): a client that is held up delays the cycle. Otherwise JACK leaves the client
    # out of it, and on a machine that stalls the samples of whole cycles are not heard.
    command = ["jackd", "-R", "-P", "60", "-S", "-t", "5000"]
    command += ["-n", environment["JACK_DEFAULT_SERVER"]]
    command += ["-d", "dummy", "-r", "48000", "-p", "480", "-C", "0", "-P", "2"]
    capture = None
    with (folder / "jackd.log").open("w") as log:
        server = subprocess.Popen(command, env=environment, stdout=log, stderr=subprocess.STDOUT)
        try:
            capture = _start_capture(folder, environment, server)
            wave = folder / "wave.npy"
            address = f"audio:device=cap,full_scale_v={FULL_SCALE_V},trigger=yes,watchdog_s=1"
            player = subprocess.run(
                [
                    sys.executable,
                    HERE / "audio_player.py",
                    address,
                    str(SECONDS),
                    str(LEAD_S),
                    wave,
                ],
                env=environment,
                capture_output=True,
                text=True,
                timeout=600,
            )
            assert player.returncode == 0, player.stderr
            capture.communicate(timeout=600)
        finally:
            for process in (capture, server):
                if process is not None and process.poll() is None:
                    process.terminate()
                    process.wait(10)
    told = json.loads(player.stdout.splitlines()[-1])
    told["capture"] = json.loads((folder / "capture.json").read_text())
    return np.load(wave), np.load(folder / "heard.npy"), told


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


def test_what_is_heard_is_what_was_played_bit_for_bit(played):
    volts, heard, _ = played
    codes = volts_to_codes(volts, FULL_SCALE_V)
    first = int(np.flatnonzero(heard[0])[0])
    wanted = (codes / 32767).astype(np.float32)
    np.testing.assert_array_equal(heard[0][first : first + codes.size], wanted)
    # Silence before, a ramp of 5 ms at the end, and silence for good.
    after = heard[0][first + codes.size :]
    assert np.abs(after[:240]).max() <= np.abs(wanted[-1])
    assert not after[240:].any()


def test_the_trigger_comes_with_the_first_sample(played):
    _, heard, _ = played
    high = np.flatnonzero(heard[1])
    # 1 ms at 48 kHz, with the silence that the stream begins with: nothing is heard before it.
    assert high.size == 48
    assert high[-1] - high[0] == 47
    assert high[0] <= np.flatnonzero(heard[0])[0]


def test_no_underrun_and_a_true_drift(played, record_property):
    _, _, told = played
    for key, value in told.items():
        record_property(key, value)
    assert told["underruns"] == 0
    # JACK's ports state a latency of a day: it is told as unknown, not believed.
    assert told["latency_s"] is None or told["latency_s"] < 1.0
    # A callback every 10 ms, while it was open.
    assert told["callbacks"] >= SECONDS / 0.010
    # The dummy driver takes its time from the host's clock, in steps of 10 ms; what a stall of the
    # machine costs, it does not make up. A step in the middle changes a fitted slope most: by 1.5.
    assert abs(told["drift_ppm"]) < 1.5e6 * (0.010 + told["slip_s"]) / SECONDS
    print(json.dumps(told))  # noqa: T201
