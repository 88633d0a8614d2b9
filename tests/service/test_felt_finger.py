"""What is felt live, against the virtual finger of `haptix render` on the same stroke."""

from types import SimpleNamespace

import numpy as np
import pytest

from haptix import FrictionSurface, Texture
from haptix.feel.motion import Trajectory
from haptix.model.perception.thresholds import WEBER_FRACTION
from haptix.play.simulation import Played, Setting
from haptix.play.touch import TouchEvent
from haptix.play.virtual_finger import TouchPanel, VirtualFinger
from haptix.service.worker import felt_finger as felt_finger_module
from haptix.service.worker.felt_finger import FeltFinger
from haptix.service.worker.process import Worker
from tests.live_strokes import SteppedRenderer

START_S, END_S = 100.0, 100.4
STRIPES = Texture(np.tile([0.2, 0.9, 0.5, 0.3], (2, 8)), width_mm=30.0, beyond="hold")


def path():
    """A finger that turns, and presses unevenly, on the clock of a machine that has run a while."""
    t_s = np.arange(START_S, END_S + 1e-9, 0.01)
    x_mm = 15 + 10 * np.sin(9 * (t_s - START_S))
    return Trajectory.of(t_s, x_mm, 5.0, 0.5 + 0.1 * np.cos(20 * t_s))


@pytest.fixture(scope="module")
def felt_finger():
    return FeltFinger("semi-wet", "3m-sct3250", 4000.0)


@pytest.fixture(scope="module")
def played(model):
    scene = {"normal_force_n": (0.4, 0.6), "frequency_hz": 4000.0}
    surface = FrictionSurface.build(model, scene, tolerance=2e-3)
    seen = TouchPanel(100.0, 0.02).read(path())
    with SteppedRenderer(surface, STRIPES) as renderer:
        rows = (seen.t_s, seen.x_mm, seen.y_mm, seen.normal_force_n, seen.arrival_s)
        for t, x, y, force, arrival in zip(*(row.tolist() for row in rows), strict=True):
            renderer.event(TouchEvent(t - START_S, 0, x, y, "move", force), arrival - START_S)
    setting, volts = Setting(model, STRIPES, path()), renderer.device.mock.played_v
    return Played(setting, renderer, renderer.device, volts, START_S)


def feel(felt_finger, played, every, lag_s=0.0):
    """Play a stroke to the virtual finger as the service does, and return times and friction."""
    part = played.renderer.played
    amplitude, step_s, begin_s = part.amplitude_v, part.step_s, START_S + part.t0_s
    reports = [
        TouchEvent(t_s, 3, x_mm, y_mm, "move", force_n, None)
        for t_s, x_mm, y_mm, force_n in zip(
            *(getattr(path(), name) for name in ("t_s", "x_mm", "y_mm", "normal_force_n")),
            strict=True,
        )
    ]
    frames = []
    for number, first in enumerate(range(0, len(amplitude), 240)):
        piece, t0_s = amplitude[first : first + 240], begin_s + first * step_s
        felt_finger.play(t0_s, step_s, piece)
        now_s = t0_s + len(piece) * step_s
        felt_finger.touch([one for one in reports if one.t_s <= now_s - lag_s])
        reports = [one for one in reports if one.t_s > now_s - lag_s]
        if number % every == 0:
            frames += felt_finger.feel(now_s)
    frames += felt_finger.feel(now_s + 1.0)
    assert {frame.touch_id for frame in frames} == {3}
    times = [frame.t0_s + frame.step_s * np.arange(len(frame.rows)) for frame in frames]
    return np.concatenate(times), np.concatenate([frame.rows[:, 0] for frame in frames])


@pytest.mark.parametrize(("every", "lag_s"), [(2, 0.0), (3, 0.03)])
def test_felt_is_what_haptix_render_feels(felt_finger, played, model, every, lag_s):
    t_s, mu = feel(felt_finger, played, every, lag_s)
    whole = played.feel(VirtualFinger(model))
    expected = np.interp(t_s, whole.t_s, whole.mu)
    # Before the fade-in and once it ends there are steps, which the whole's band limit softens.
    inside = (t_s > START_S + 0.03) & (t_s < END_S - 0.03) & ~np.isnan(mu + expected)
    assert inside.sum() > 300 and np.ptp(expected[inside]) > 0.03
    error_jnd = np.abs(mu - expected)[inside] / (WEBER_FRACTION * expected[inside])
    assert error_jnd.max() < 0.02  # of issue 20


def test_a_finger_that_lifts_is_felt_until_then(felt_finger):
    silence = np.full(1200, 80.0)
    slide = [TouchEvent(500 + 0.01 * k, 1, 1.0 * k, 0.0, "move", 0.5, None) for k in range(6)]
    felt_finger.touch([*slide, TouchEvent(500.05, 1, 0.0, 0.0, "up", None, None)])
    felt_finger.play(500.0, 1 / 12_000, silence)
    (frame,) = felt_finger.feel(500.2)
    assert frame.t0_s == 500.0 and len(frame.rows) == 50
    assert not np.isnan(frame.rows).any()
    felt_finger.play(500.1, 1 / 12_000, silence)
    assert felt_finger.feel(500.3) == []


def test_a_break_in_what_is_played_begins_anew(felt_finger):
    slide = [TouchEvent(600 + 0.01 * k, 1, 1.0 * k, 0.0, "move", 0.5, None) for k in range(61)]
    felt_finger.touch(slide)
    felt_finger.play(600.0, 1 / 12_000, np.full(1200, 80.0))
    assert len(felt_finger.feel(600.61)[0].rows) == 99
    felt_finger.play(600.5, 1 / 12_000, np.full(1200, 80.0))
    (frame,) = felt_finger.feel(600.61)
    assert (frame.t0_s, len(frame.rows)) == (600.5, 99)


def test_it_loads_at_full_priority_and_yields_before_it_feels(monkeypatch):
    """Where others use both cores, one that yields from the start loads for a minute."""
    steps = []
    monkeypatch.setattr("os.nice", lambda nice: steps.append(nice))
    monkeypatch.setattr(felt_finger_module, "FeltFinger", lambda *_: steps.append("loaded"))
    monkeypatch.setattr(felt_finger_module, "FeltFingerThread", lambda *_: steps.append("feels"))
    worker = Worker(SimpleNamespace(tell=None), iter(()))
    worker._do_feel("semi-wet", "3m-sct3250", 4000.0, nice=5)
    assert steps == ["loaded", 5, "feels"]
