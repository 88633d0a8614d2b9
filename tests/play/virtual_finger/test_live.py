"""A finger that feels part by part, against the same finger that feels all at once."""

import itertools

import numpy as np
import pytest

from haptix import InputError
from haptix.feel.motion import Trajectory
from haptix.play.virtual_finger import VirtualFinger
from haptix.play.virtual_finger.finger import LiveVirtualFinger

RATE_HZ, CARRIER_HZ, AMPLITUDE_HZ = 1000.0, 4000.0, 12_000.0


def stroke(seed):
    """A finger that turns and changes its speed and force, reported each 8 ms."""
    rng = np.random.default_rng(seed)
    t_s = 0.3 + 0.008 * np.arange(40)
    x_mm = 40 + 20 * np.sin(8 * t_s + seed)
    return Trajectory.of(t_s, x_mm, 3.0 * t_s, rng.uniform(0.2, 1.0, 40))


def part_of(path, from_s, to_s):
    inner = path.t_s[(path.t_s > from_s) & (path.t_s < to_s)]
    t_s = np.concatenate([[from_s], inner, [to_s]])
    return Trajectory(t_s, *path.at(t_s))


def test_parts_feel_as_the_whole(model):
    finger = VirtualFinger(model)
    paths = {4: stroke(0), 9: stroke(1)}
    amplitude = 100 + 70 * np.sin(np.arange(6000) / 100)
    live = LiveVirtualFinger(finger, CARRIER_HZ, RATE_HZ)
    found = {number: [] for number in paths}
    edges = 0.3 + np.array([0.0, 0.05, 0.071, 0.2, 0.3])
    for from_s, to_s in itertools.pairwise(edges.tolist()):
        parts = {number: part_of(path, from_s, to_s) for number, path in paths.items()}
        for number, felt in live.feel(amplitude, AMPLITUDE_HZ, 0.25, parts).items():
            found[number].append(felt)
    for number, path in paths.items():
        whole = finger.feel_carrier(
            amplitude, AMPLITUDE_HZ, CARRIER_HZ,
            path.t_s, path.x_mm, path.y_mm, path.normal_force_n, 0.25, RATE_HZ,
        )  # fmt: skip
        mu = np.concatenate([felt.mu for felt in found[number]])
        assert len(mu) == 300 and np.ptp(mu) > 0.05
        # A knot of the path may fall on either side of an instant by its rounding.
        assert mu == pytest.approx(whole.mu[:300], rel=1e-6)


def test_nobody_feels_nothing_and_a_path_too_short_is_refused(model):
    live = LiveVirtualFinger(VirtualFinger(model), CARRIER_HZ)
    assert live.feel(np.zeros(100), AMPLITUDE_HZ, 0.0, {}) == {}
    short = Trajectory.of([0.0, 0.0001], [0.0, 1.0], 0.0, 0.5)
    with pytest.raises(InputError, match=r"0\.001 s"):
        live.feel(np.zeros(100), AMPLITUDE_HZ, 0.0, {0: short})
