"""Fingers that slide at a constant speed, rendered in virtual time."""

from typing import Any

import numpy as np

import haptix
from haptix import Texture
from haptix.feel.materials import FrictionField
from haptix.play.render import LiveRenderer, LiveSettings, Sliding
from haptix.play.render.played import COLUMNS, PlayedRecord
from haptix.play.touch import TouchEvent

RATE = 48_000.0
CARRIER_HZ = 3000.0
REACTION_S = 0.003
ALWAYS = Sliding(is_needed=False)
FULL = Texture(np.ones((2, 2)), width_mm=100.0, beyond="hold")
HALF = Texture(np.full((2, 2), 0.5), width_mm=100.0, beyond="hold")


class Ruler(FrictionField):
    """Friction that tells the place: `place_mm` reads it in what was played."""

    LOW, PER_MM = 0.27, 5e-4  # within reach up to 80 mm

    target = "mu"
    outside = LOW

    def _sample(self, x_mm, y_mm, footprint_mm):
        return self.LOW + self.PER_MM * x_mm

    def place_mm(self, renderer):
        """Place at `row_times`."""
        return (target_mu(renderer) - self.LOW) / self.PER_MM


class SteppedRenderer(LiveRenderer):
    """A live renderer in steps; `played` is all that it has played."""

    played: Any  # PlayedPart

    def __init__(self, surface, texture, drive=None, settings=None, address="mock:pace=stepped"):
        super().__init__(surface, texture, haptix.open_device(address), drive, settings)

    def __enter__(self):
        super().__enter__()
        self.record = PlayedRecord(self)
        self.record._next = 1  # from the first point on
        return self

    def __exit__(self, kind, error, traceback):
        self.played = self.record.take(self.now_s())
        super().__exit__(kind, error, traceback)
        self.device.clock.sleep(0.01)  # in which the driver has ramped to 0 V


def stroke(
    end_s=0.5, speed_mm_s=100.0, start_mm=5.0, rate_hz=100.0, force=0.5, touch_id=0, begin_s=0.0
):
    """Touches of a finger that slides to the right at a constant speed, from the start on."""
    t = np.arange(begin_s, end_s, 1 / rate_hz)
    x = start_mm + speed_mm_s * (t - begin_s)
    return [TouchEvent(a, touch_id, b, 10.0, "move", force) for a, b in zip(t, x, strict=True)]


def still(end_s=0.5, x_mm=20.0, **options):
    return stroke(end_s, 0.0, x_mm, **options)


def render(surface, texture, events, latency_s=0.0, drive=None, **options):
    renderer = SteppedRenderer(surface, texture, drive, LiveSettings(**options))
    device = renderer.device
    with renderer:
        for event in events:
            renderer.event(event, event.t_s + latency_s)
    assert device.mock.output[0][-1] == 0
    assert not device.is_armed
    return device, renderer


def amplitude(renderer):
    """Amplitudes that were played, at `times`."""
    return renderer.played.amplitude_v


def times(renderer):
    played = renderer.played
    return played.t0_s + played.step_s * np.arange(len(played.amplitude_v))


def target_mu(renderer, touch_id=0):
    """Friction that a finger asked for, at `row_times`; NaN where it got no drive."""
    return renderer.played.rows[touch_id][:, COLUMNS.index("wanted")]


def row_times(renderer, touch_id=0):
    played = renderer.played
    return played.t0_s + played.row_s * np.arange(len(played.rows[touch_id]))


def of_model(surface, level, force):
    """Amplitude of a share of what is reachable, by the surface itself."""
    low, high = (float(surface.mu(force, v, CARRIER_HZ)) for v in (0.0, 200.0))
    return float(surface.voltage(low + level * (high - low), force, CARRIER_HZ).voltage_v)
