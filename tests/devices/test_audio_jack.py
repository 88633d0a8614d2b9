"""The audio link through the real PortAudio, into JACK's dummy driver: `make test-devices`.

Needs Debian's jackd2 and libportaudio2, and pip's JACK-Client.
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from firmware_io import volts_to_codes
from tests.devices.jack_session import jack_session, missing

pytestmark = pytest.mark.devices

HERE = Path(__file__).parent
SECONDS = 3.0
FULL_SCALE_V = 200.0
#: What the player may be held up without an underrun. It has real-time priority, as JACK has, so
#: that no other program holds it up, but the host of a virtual machine may; 0.25 s is too long.
HORIZON_S = 0.1


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """What was played, heard and told."""
    if missing():
        pytest.skip(f"missing: {missing()}")
    for _ in range(3):
        volts, heard, told = _play(tmp_path_factory.mktemp("jack"))
        # A machine that stood still for the horizon says nothing about the link: play again.
        if told["capture"]["longest_stall_s"] < HORIZON_S / 2:
            break
    return volts, heard, told


def _play(folder):
    wave = folder / "wave.npy"
    address = f"audio:device=cap,full_scale_v={FULL_SCALE_V},trigger=yes"
    with jack_session(folder) as hearing:
        player = subprocess.run(
            [*(sys.executable, str(HERE / "audio_player.py"), address), *(str(SECONDS), str(wave))],
            env=hearing.environment,
            capture_output=True,
            text=True,
            timeout=600,
        )
        assert player.returncode == 0, player.stderr
    told = json.loads(player.stdout.splitlines()[-1]) | {"capture": hearing.told}
    return np.load(wave), hearing.samples, told


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


def test_no_underrun_and_a_callback_in_time(played, record_property):
    _, _, told = played
    for key, value in told.items():
        record_property(key, value)
    assert told["underruns"] == 0
    # JACK's ports state a latency of a day: it is told as unknown, not believed.
    assert told["latency_s"] is None or told["latency_s"] < 1.0
    # A callback every 10 ms, while it was open.
    assert told["callbacks"] >= SECONDS / 0.010
    print(json.dumps(told))  # noqa: T201
