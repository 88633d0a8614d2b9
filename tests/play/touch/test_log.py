"""Touches that are dropped are logged, and why."""

import logging

from haptix.play.touch import TouchEvent, TouchSettings
from haptix.play.touch.touches import Touches


def test_what_was_dropped_and_why(caplog):
    caplog.set_level(logging.INFO, "haptix.play.touch")
    touches = Touches(TouchSettings(), strict=False)
    assert touches.push(TouchEvent(10.0, 1, 5.0, 5.0, "down", 0.5), 10.0)
    assert not touches.push(TouchEvent(9.0, 1, 5.0, 5.0, "move", 0.5), 10.0)
    assert not touches.push(TouchEvent(10.1, 2, 0.0, 0.0, "up"), 10.1)
    assert [record.getMessage() for record in caplog.records] == [
        "dropped: stale",
        "dropped: touch 2: went up, but was not down",
    ]
