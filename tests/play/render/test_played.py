"""What a live stream is said to have played: against what its source queued."""

import numpy as np
import pytest
import torch

from firmware_io import Device, MockDriver, MockLink
from haptix import Texture
from haptix.play.render import LiveSettings
from haptix.play.render.fingers import PredictedFingers
from haptix.play.render.live import RenderSource
from haptix.play.render.master import Master
from haptix.play.render.played import COLUMNS, PlayedRecord
from haptix.play.render.samples import RenderCore
from haptix.play.touch import TouchEvent

RATE_HZ, STEP_S, START_S = 48_000, 1 / 12_000, 0.2
STRIPES = Texture(
    np.tile(0.5 + 0.4 * np.sin(np.arange(200) / 3), (2, 1)), width_mm=60.0, beyond="hold"
)
VX = 100.0


class Recorded:
    """A stream of two sliding fingers that is rendered, revised and recorded."""

    def __init__(self, surface):
        self.core = RenderCore(surface, STRIPES, Device(MockLink(MockDriver())))
        self.fingers = PredictedFingers(LiveSettings())
        self.record = PlayedRecord(self.core)
        self.source = RenderSource(
            self.core, self.fingers, Master(lambda: None), lambda *_: None, lambda: self.record
        )
        self.sent = 0
        for k in range(20):
            self.report(0.01 * k)

    def report(self, t_s):
        for touch_id, y_mm in ((7, 8.0), (3, 9.0)):
            event = TouchEvent(t_s, touch_id, 5.0 + VX * t_s, y_mm, "move", 0.4 + 0.1 * (y_mm - 8))
            self.fingers.take(event, t_s)

    def window(self, first, count, is_revision):
        self.source.window(first, count, START_S + first / RATE_HZ, is_revision)
        self.sent = max(self.sent, first + count)


def test_amplitudes_are_those_that_were_queued_last(surface):
    rng = np.random.default_rng(5)
    stream = Recorded(surface)
    for _ in range(6):
        stream.window(stream.sent, 960, False)
    parts = []
    for k in range(60):
        now_s = START_S + 0.001 * k
        stream.report(now_s - 0.001)
        stream.window(4 * int(rng.integers(12 * k + 40, 12 * k + 80)), 480, True)
        refused = rng.random() < 0.3
        stream.source.settle(0 if refused else 1, bool(refused))
        if (part := stream.record.take(now_s)) is not None:
            parts.append(part)
    queued = stream.source.amplitudes.values
    played = np.concatenate([part.amplitude_v for part in parts])
    first = round((parts[0].t0_s - START_S) / STEP_S)
    assert len(played) >= 50 * 12
    assert np.array_equal(played, queued[first : first + len(played)])
    # Parts meet: each begins where the one before has ended.
    ends = [part.t0_s + len(part.amplitude_v) * STEP_S for part in parts]
    assert [part.t0_s for part in parts[1:]] == pytest.approx(ends[:-1], abs=1e-9)


def test_rows_tell_place_friction_and_range_of_each_finger(surface):
    stream = Recorded(surface)
    stream.window(0, 2880, False)
    stream.report(START_S)
    stream.window(480, 960, True)  # 10 to 30 ms: no finger before its first revision
    part = stream.record.take(START_S + 0.025)
    assert part.row_s == pytest.approx(0.001)
    assert part.rows == {} or set(part.rows) == {3, 7}
    part = stream.record.take(START_S + 0.029)
    assert set(part.rows) == {3, 7}
    times = part.t0_s + part.row_s * np.arange(len(part.rows[7]))
    for touch_id, force_n in ((7, 0.4), (3, 0.5)):
        row = dict(zip(COLUMNS, part.rows[touch_id].T, strict=True))
        # A steady finger is predicted to 0.3 mm, the noise that the filter expects of a panel.
        assert row["x_mm"] == pytest.approx(5.0 + VX * times, abs=0.3)
        assert row["normal_force_n"] == pytest.approx(force_n)
        volts = torch.from_numpy(part.amplitude_v[::12].copy())
        found = stream.core.surface.evaluate(torch.full_like(volts, force_n), volts)
        # float32 tables in one of the two; a JND is 0.03 here.
        assert row["reached"] == pytest.approx(found.mu.cpu().numpy(), rel=1e-5)
        assert row["voltage_share"] == pytest.approx(volts.numpy() / stream.core.highest_v)
        assert (row["low"] < row["wanted"]).all() and (row["wanted"] < row["high"]).all()


def test_a_finger_that_leaves_has_no_rows_and_old_windows_are_forgotten(surface):
    stream = Recorded(surface)
    stream.window(0, 960, False)
    stream.window(0, 960, True)
    stream.source.settle(1, False)
    assert set(stream.record.take(START_S + 0.019).rows) == {3, 7}
    for touch_id in (3, 7):
        stream.fingers.take(TouchEvent(START_S, touch_id, 0.0, 0.0, "up"), START_S)
    stream.window(960, 4800, False)
    stream.window(1920, 1920, True)  # fades out in 20 ms, then none
    stream.source.settle(1, False)
    stream.record.take(START_S + 0.079)
    part = stream.record.take(START_S + 0.11)
    assert part.rows == {} and not part.amplitude_v.any()
    assert len(stream.record._windows) <= 2
    assert stream.record.take(START_S + 0.1) is None  # nothing is told twice
