"""Programs with a window or a touchscreen: the session without a display, and the window on one."""

import os
import shutil
import subprocess
import sys
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from haptix import InputError
from haptix.play.touch import TouchEvent
from tests.hand_clock import HandClock
from tests.programs import load
from tests.waiting import pause, wait_for

FOLDER = Path(__file__).parents[2] / "examples"


def test_the_mouse_is_a_finger(steady_mock):
    session = load("examples/mouse_finger.py").Session("mock:pace=real")
    heard = []
    with session.renderer:

        def slid(i: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            session.finger(100 + 4 * (i % 60), 120)  # from 14 mm on: the photograph, the grating
            heard.append(session.said)
            if i == 30:
                session.drag(500, 300)
            pause(0.005)
            return session.lately()  # as the window does

        strokes = map(slid, count())
        wait_for(lambda: next(strokes)[2].max(initial=0.0) > 20 and "enter Texture" in heard)
        while len(heard) < 60:
            next(strokes)
        session.lift()
        ages, friction, volts = session.lately()
    assert session.photograph.x_mm == pytest.approx(500 / 7 - 25)
    assert "enter Texture" in heard
    assert len(ages) == len(friction) == len(volts) > 0
    assert np.nanmax(friction) > 0.2  # the range of the surface: 0.26 and more
    assert volts.max() > 20
    session.press(100)
    assert session.force_n == 2.0


WINDOW = """
import sys
import firmware_io.links.mock
from tests.steady_clock import steady_driver
firmware_io.links.mock.MockDriver = steady_driver  # a stall of this machine starves none
sys.path.insert(0, {folder!r})
import mouse_finger as program
session = program.Session("mock:pace=real")
with session.renderer:
    window = program.Window(session)
    def step(i=0):
        at = {{"x": 100 + 3 * (i % 60), "y": 120}}
        window.pad.event_generate("<B1-Motion>" if i else "<Button-1>", **at)
        taken, rows = session.renderer.touch_counts.taken, session.rows.shape[1]
        if taken <= 50 or rows <= 300 or "enter" not in window.words["text"]:
            window.after(10, step, i + 1)
        else:
            window.pad.event_generate("<ButtonRelease-1>", x=300, y=120)
            print(window.words["text"])
            window.after(100, window.destroy)
    window.after(300, step)
    window.mainloop()
print(session.renderer.touch_counts.taken, session.rows.shape[1])
"""


@pytest.mark.devices
def test_the_window_on_a_display():
    server = shutil.which("Xvfb")
    if server is None:
        pytest.skip("no Xvfb: bash scripts/setup-devices.sh")
    read, write = os.pipe()
    with subprocess.Popen([server, "-displayfd", str(write)], pass_fds=[write]) as display:
        try:
            number = os.read(read, 16).decode().strip()
            done = subprocess.run(
                [sys.executable, "-c", WINDOW.format(folder=str(FOLDER))],
                env={**os.environ, "DISPLAY": f":{number}"},
                capture_output=True, text=True, timeout=300, cwd=FOLDER.parent,
            )  # fmt: skip
        finally:
            display.terminate()
    assert done.returncode == 0, done.stderr
    words, counts = done.stdout.splitlines()[-2:]
    assert "friction" in words and "enter" in words
    taken, rows = map(int, counts.split())
    assert taken > 50 and rows > 300  # of a millisecond


class Reports:
    """A touchscreen of another machine."""

    def __init__(self, events, clock):
        self.events, self.clock = events, clock

    def read(self, timeout_s):
        self.clock.sleep(timeout_s)
        found, self.events = self.events[:5], self.events[5:]
        return [one._replace(t_s=self.clock()) for one in found]


def test_a_touchscreen_is_followed():
    program = load("examples/touchscreen_photograph.py")
    taken, clock = [], HandClock()

    class Renderer:
        now_s = clock
        event = staticmethod(taken.append)

    events = [TouchEvent(0.0, 1, float(i), 0.0) for i in range(12)]
    program.follow(Renderer(), Reports(events, clock), 0.1)
    assert [one.x_mm for one in taken] == [one.x_mm for one in events]
    with pytest.raises(InputError, match="touchscreen"):
        program.main()
