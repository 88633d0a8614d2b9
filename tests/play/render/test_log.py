"""A renderer logs its begin, its touches, what an app turns, and what it has played."""

import logging

from firmware_io import open_device
from haptix import LiveRenderer
from haptix.feel.materials import Grating


def test_a_stroke_and_what_was_turned(surface, caplog):
    caplog.set_level(logging.DEBUG, "haptix.play.render")
    device = open_device("mock:pace=stepped")
    texture = Grating(period_mm=2.0)
    with LiveRenderer(surface, texture, device) as renderer:
        began_s = renderer.now_s()
        for number in range(5):
            renderer.touch(began_s + 0.01 * number, 10.0 + number, 5.0, 0.5)
        renderer.mute()
        renderer.run_until(began_s + 0.2)
    device.close()
    said = [each.getMessage() for each in caplog.records if each.name == "haptix.play.render"]
    limit = f"{surface.voltage_limit_v:g}"
    assert said[0] == f"LiveRenderer begins, up to {limit} V on mock"
    assert said[1].startswith("own_thread: plays by the interpreter: mock has no waveform")
    assert said[2] == f"touch 0 move at {began_s:.6f} s, 10, 5 mm"
    assert said[7] == "is_muted True"
    assert said[8] == f"LiveRenderer ends: {renderer.stats}"
    assert len(said) == 9
