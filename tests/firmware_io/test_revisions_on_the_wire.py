"""Samples revised while they wait: what is played, what is refused, and that no limit is passed."""

from dataclasses import replace

import numpy as np
import pytest

from firmware_io.protocol import FaultCode, Ping, Revise, StatusReport, StreamMode
from tests.firmware_io.core_rig import BOARD, CARRIED, PLAIN, RAMP, TOP, Rig

GUARD = BOARD.guard_ticks


@pytest.fixture
def rig():
    return Rig()


def revise(rig, index, codes, revision=None, mode=StreamMode.WAVEFORM):
    if revision is None:
        revision = rig.core.status().revisions
    return rig.say(Revise(index % 2**32, np.array(codes, np.int16), mode, revision))


@pytest.mark.parametrize("seed", range(5))
def test_what_is_played_is_what_was_revised_last(rig, seed):
    """A model of one line: an array, of which a revision in time replaces a part."""
    rng = np.random.default_rng(seed)
    rig.ready()
    wanted, played, obeyed = np.empty(0, int), [], 0
    for _ in range(60):
        at, queued = len(played), len(wanted) - len(played)
        if queued < 300:
            codes = rng.integers(-TOP, TOP, rng.integers(1, 400))
            rig.stream(codes)
            wanted = np.r_[wanted, codes]
            continue
        first = at + int(rng.integers(-30, queued - 1))
        codes = rng.integers(-TOP, TOP, rng.integers(1, min(100, len(wanted) - first) + 1))
        is_stale = rng.random() < 0.2
        answers = revise(rig, first, codes, obeyed + is_stale)
        status = rig.core.status()
        if first - at >= GUARD and not is_stale:
            wanted[first : first + codes.size] = codes
            obeyed += 1
            assert answers == []
        else:
            assert [type(answer) for answer in answers] == [StatusReport]
        assert (status.revisions, status.margin_samples) == (obeyed, first - at)
        ticks = int(rng.integers(0, 50))
        played += rig.play(min(ticks, queued))
    assert 10 < obeyed < 60
    assert played == wanted[: len(played)].tolist()
    assert rig.core.fault() is None


def test_an_envelope_is_revised_in_samples_of_its_own_rate(rig):
    """The guard is of output samples: 16 of them are 6 of a stream at a third of the rate."""
    rig.ready(CARRIED)
    rig.stream([1000] * 100, StreamMode.ENVELOPE)
    rig.play(3)
    for ahead, is_obeyed in ((5, False), (6, True)):
        revise(rig, 1 + ahead, [1200], mode=StreamMode.ENVELOPE)
        assert rig.core.status().revisions == is_obeyed
    assert rig.core.status().refused == 1


def test_a_revision_feeds_the_watchdog_and_a_refused_one_does_not(rig):
    for is_late in (False, True):
        rig.ready(replace(PLAIN, watchdog_ms=20))  # 960 ticks, of which the ramp takes the last
        rig.stream([5] * 1000)
        rig.stream([5] * 1000)
        rig.play(700)
        revise(rig, 710 if is_late else 800, [6])
        rig.play(700)
        assert (rig.core.status().fault is FaultCode.STARVED) == is_late
        rig.core.release()
        rig.play(RAMP)


@pytest.mark.parametrize("queued", [TOP, 0])
@pytest.mark.parametrize("is_revised", [True, False])
def test_the_mean_is_that_of_what_is_played(rig, queued, is_revised):
    """A second holds 2400 samples at the ceiling; half of those queued first are revised."""
    rig.ready()
    rig.stream([queued] * 1000)
    rig.stream([queued] * 1000)
    codes = rig.play(400)
    if is_revised:
        revise(rig, 1000, [TOP - queued] * 1000)
    codes += rig.play(1600)
    rig.stream([TOP] * 1000)
    codes += rig.play(1000)
    at_the_ceiling = 1000 + (1000 if is_revised else 2000 * (queued > 0))
    assert (rig.core.fault() is not None) == (at_the_ceiling > 2400)
    if at_the_ceiling > 2400:
        assert rig.core.fault().code is FaultCode.MEAN
        assert TOP * 2200 < sum(codes) <= TOP * 2400


@pytest.mark.parametrize(
    ("first", "codes", "expected"),
    [
        (20, [TOP + 1], FaultCode.CEILING),
        (20, [3600, 0, 0, 0], FaultCode.SLEW),  # from the sample before
        (20, [0, 0, 3600, 0], FaultCode.SLEW),  # inside
        (20, [0, 1800, 3590], FaultCode.SLEW),  # to the sample behind
        (95, [0] * 6, FaultCode.SAMPLE_INDEX),
        (101, [0], FaultCode.SAMPLE_INDEX),
    ],
)
def test_what_breaks_a_limit_ends_the_output(rig, first, codes, expected):
    """A slew of 131 kV/s: 3577 codes of 48 kHz."""
    rig.ready(replace(PLAIN, max_slew_v_per_s=131_000))
    rig.stream([0] * 100)
    (fault,) = revise(rig, first, codes)
    assert fault.code is expected
    assert rig.play(RAMP) == [0] * RAMP
    assert rig.core.status().revisions == 0


def test_disarmed_or_of_another_mode_it_is_a_fault(rig):
    (fault,) = revise(rig, 0, [0])
    assert fault.code is FaultCode.NOT_ARMED
    rig.ready()
    rig.stream([0] * 100)
    (fault,) = revise(rig, 50, [0], mode=StreamMode.ENVELOPE)
    assert fault.code is FaultCode.MODE


def test_behind_a_refusal_those_under_way_are_refused_too(rig):
    rig.ready()
    rig.stream([1] * 200)
    rig.play(10)
    revise(rig, 11, [2], revision=0)  # late
    revise(rig, 60, [3], revision=1)  # sent before the host could know
    revise(rig, 70, [4], revision=0)  # in step again
    assert rig.play(100) == [1] * 60 + [4] + [1] * 39
    (status,) = rig.say(Ping(1))
    assert (status.revisions, status.refused) == (1, 2)
    rig.core.release()
    rig.ready()
    assert rig.core.status().refused == 0


def test_arming_again_counts_anew(rig):
    rig.ready()
    rig.stream([1] * 100)
    revise(rig, 50, [2])
    rig.core.release()
    rig.play(RAMP)
    rig.ready()
    rig.stream([1] * 100)
    revise(rig, 50, [2], revision=0)
    assert rig.play(100)[50] == 2
