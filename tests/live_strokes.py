"""Fingers that slide at a constant speed, rendered in virtual time."""

import numpy as np

import haptix
from haptix import Texture
from haptix.render import LiveSettings, PredictingRenderer, Sliding
from haptix.texture import FrictionField
from haptix.touch import TouchEvent

RATE = 48_000.0
CARRIER_HZ = 3000.0
LEAD_S = 0.025
ALWAYS = Sliding(is_needed=False)
KEEP = LiveSettings(keep_blocks=True)
FULL = Texture(np.ones((2, 2)), width_mm=100.0, beyond="hold")
HALF = Texture(np.full((2, 2), 0.5), width_mm=100.0, beyond="hold")


class Ruler(FrictionField):
    """Friction that tells the place: blocks keep it, and `place_mm` reads it."""

    LOW, PER_MM = 0.27, 5e-4  # within reach up to 80 mm

    target = "mu"
    outside = LOW

    def _sample(self, x_mm, y_mm, footprint_mm):
        return self.LOW + self.PER_MM * x_mm

    def place_mm(self, renderer):
        nowhere = np.full(len(renderer.blocks[0].amplitude_v), np.nan)
        wanted = [block.target_mu if block.fingers else nowhere for block in renderer.blocks]
        return (np.concatenate(wanted) - self.LOW) / self.PER_MM


def stroke(
    end_s=0.5, speed_mm_s=100.0, start_mm=5.0, rate_hz=100.0, force=0.5, touch_id=0, begin_s=0.0
):
    """Touches of a finger that slides to the right at a constant speed, from the start on."""
    t = np.arange(begin_s, end_s, 1 / rate_hz)
    x = start_mm + speed_mm_s * (t - begin_s)
    return [TouchEvent(a, touch_id, b, 10.0, "move", force) for a, b in zip(t, x, strict=True)]


def still(end_s=0.5, x_mm=20.0, **options):
    return stroke(end_s, 0.0, x_mm, **options)


def render(surface, texture, events, latency_s=0.0, address="mock:", drive=None, **options):
    device = haptix.open_device(address)
    settings = LiveSettings(**{"lead_s": LEAD_S, "keep_blocks": True, **options})
    renderer = PredictingRenderer(surface, texture, device, drive, settings)
    with renderer:
        for event in events:
            renderer.event(event, event.t_s + latency_s)
    assert device.mock.played_codes[-1] == 0
    assert not device.is_armed
    return device, renderer


def amplitude(renderer):
    return np.concatenate([block.amplitude_v for block in renderer.blocks])


def times(renderer):
    return np.concatenate([block.sample for block in renderer.blocks]) / RATE


def of_model(surface, level, force):
    """Amplitude of a share of what is reachable, by the surface itself."""
    low, high = (float(surface.mu(force, v, CARRIER_HZ)) for v in (0.0, 200.0))
    return float(surface.voltage(low + level * (high - low), force, CARRIER_HZ).voltage_v)
