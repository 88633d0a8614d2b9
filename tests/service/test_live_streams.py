"""Friction and felt friction of the whole service, against the driver's own record."""

from math import log

import numpy as np
import pytest

from haptix.play.sensing import Knowledge
from haptix.service.protocol.batches import COLUMNS
from tests.service.test_processes import LAYOUT, Running
from tests.waiting import pause, wait_for

pytestmark = pytest.mark.slow  # starts the whole service


LEARNS = list(Knowledge).index(Knowledge.LEARNS)
SENSES = "mock:pace=real,mode=envelope,sense_rate_hz=250"


def test_a_finger_is_learned_from_the_current_of_the_driver(tmp_path):
    service = Running(tmp_path / "service", SENSES)
    frames, states = [], [""]
    try:
        with service.connect() as client:
            client.on("frame", frames.append)
            client.on("output", lambda output: states.append(output.state))
            client.layout_set(LAYOUT)
            client.acquire()
            assert client.sense(True).senses
            client.ask("subscribe", streams={"stats": 10})
            assert client.arm().senses

            # The panel is measured while nobody touches it.
            def is_measured():
                arm_again(client, states)
                return frames and stats(frames[-1])["scene_s"] > 0.5

            wait_for(is_measured)
            began_s = client.now_s()

            def has_learned():
                arm_again(client, states)
                now_s = client.now_s()
                # A session that was starved measures the panel anew, and a stall spoils an
                # estimate: the finger leaves the panel for 2 s of each 12, and begins anew.
                if now_s - began_s > 10.0 and (now_s - began_s) % 12.0 < 2.0:
                    client.lift(4)
                else:
                    client.touch(float(place_mm(now_s - began_s)), 20.0, 0.4, touch_id=4)
                pause(0.008)
                return frames and stats(frames[-1])["sensing"] == LEARNS and known(frames[-1])

            def known(frame):
                return stats(frame)["attraction_sd"] < 0.45  # a stranger's is 0.6

            wait_for(has_learned)
            learned = stats(frames[-1])
            client.stop()
    finally:
        service.close()
    assert {frame.stream for frame in frames} == {"stats"}
    # The virtual finger is the one that the surface was made for: its ratio is 1.
    assert abs(log(learned["attraction"])) < 4 * learned["attraction_sd"]


def arm_again(client, states):
    """Go on after a busy machine has starved the driver's stream, which ends a session."""
    if states[-1] == "failed":
        states.append("")
        client.arm()


def stats(frame):
    """The newest row of a frame, by column."""
    return dict(zip(COLUMNS["stats"], frame.rows[-1].tolist(), strict=True))


def test_two_fingers_are_told_apart_and_what_is_told_was_played(tmp_path):
    service = Running(tmp_path / "service")
    frames, states = [], [""]
    try:
        with service.connect() as client:
            client.on("frame", frames.append)
            client.on("output", lambda output: states.append(output.state))
            client.layout_set(LAYOUT)
            client.acquire()
            client.ask("subscribe", streams={"friction": 250, "felt": 1000})
            client.arm()
            began_s = client.now_s()

            def is_sliding():
                arm_again(client, states)
                x_mm = place_mm(client.now_s() - began_s)
                client.touch(float(x_mm), 20.0, 0.5, touch_id=4)
                client.touch(float(x_mm) + 10, 40.0, 0.4, touch_id=9)
                pause(0.008)
                return not is_short(frames)

            # The virtual finger makes its tables first, and a busy machine takes long.
            wait_for(is_sliding)
    finally:
        service.close()
    assert {(one.stream, one.touch_id) for one in frames} == {
        (stream, touch_id) for stream in ("friction", "felt") for touch_id in (4, 9)
    }
    for touch_id, dx_mm, force_n in ((4, 0.0, 0.5), (9, 10.0, 0.4)):
        friction = table(frames, "friction", touch_id)
        times, row = friction
        assert np.median(np.diff(times)) == pytest.approx(0.004, abs=1e-6)
        there = ~np.isnan(row["x_mm"])
        # Its own path, predicted over the reaction; touches of a busy machine come late.
        off_mm = [
            np.median(np.abs(row["x_mm"] - dx_mm - place_mm(times - late_s - began_s))[there])
            for late_s in np.arange(0.0, 0.5, 0.02)
        ]
        assert min(off_mm) < 2.0
        assert np.median(row["normal_force_n"][there]) == pytest.approx(force_n, rel=1e-3)
        assert (row["low"] <= row["reached"] + 1e-9)[there].all()
        assert (row["reached"] <= row["high"] + 1e-9)[there].all()
        felt_s, felt = table(frames, "felt", touch_id)
        assert np.median(np.diff(felt_s)) == pytest.approx(0.001, abs=1e-6)
        slides = ~np.isnan(felt["mu"])
        assert slides.mean() > 0.5
        assert felt["force_n"][slides] == pytest.approx(force_n * felt["mu"][slides], rel=0.02)
        # The grating is slow beside the finger's response: what is reached is felt.
        reached = np.interp(felt_s, times[there], row["reached"][there])
        error = np.abs(felt["mu"] - reached)[slides] / reached[slides]
        assert np.percentile(error, 75) < 0.03
    volts = np.abs(service.driver.output_v).max()
    share = np.nanmax(table(frames, "friction", 4)[1]["voltage_share"])
    assert volts / share == pytest.approx(186.0, rel=0.02)  # the screen's highest at 4 kHz


def place_mm(t_s):
    """Where the first finger is."""
    return 50 + 30 * np.sin(2 * t_s)


def is_short(frames):
    """Whether less than two seconds of a finger were felt."""
    felt = [one for one in frames if one.stream == "felt"]
    return any(sum(len(one.rows) for one in felt if one.touch_id == n) < 2000 for n in (4, 9))


def table(frames, stream, touch_id):
    """Times and columns of one stream and finger."""
    found = [one for one in frames if (one.stream, one.touch_id) == (stream, touch_id)]
    times = [one.t0_s + one.step_s * np.arange(len(one.rows)) for one in found]
    rows = np.concatenate([one.rows for one in found])
    return np.concatenate(times), dict(zip(COLUMNS[stream], rows.T, strict=True))
