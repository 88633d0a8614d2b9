"""A finger that does not touch the glass is no touch, by any protocol, in any order of events."""

from collections import Counter

import pytest

from haptix.play.touch import SlotDecoder, Touches
from haptix.play.touch import touchscreen as codes
from tests.play.touch.panel_events import AXES, reports

TID, X, Y = codes.ABS_MT_TRACKING_ID, codes.ABS_MT_POSITION_X, codes.ABS_MT_POSITION_Y
DISTANCE = codes.ABS_MT_DISTANCE


def places(decoder):
    return Counter(
        decoder.axes.place_mm(slot.values[X], slot.values[Y])
        for slot in decoder._slots.values()
        if slot.tracking_id is not None
    )


def check(seed, protocol):
    touches = Touches()
    for panel, found, decoder, missed in reports(seed, protocol):
        for touch in found:
            touches.push(touch)
        # Places are compared by what was decoded last: the tracker filters them.
        down = places(decoder)
        assert len(touches) == down.total()
        assert down <= panel.touching, f"{protocol}, seed {seed}: a finger that does not touch"
        # Where nothing was lost, none that touches is missed either.
        assert missed or down == panel.touching, f"{protocol}, seed {seed}: a touch is missed"


@pytest.mark.parametrize("protocol", ["B", "A", "single"])
def test_no_finger_that_hovers_is_down(protocol):
    for seed in range(500):
        check(seed, protocol)


def fed(decoder, *events):
    found = [touch for event in [*events, (0, 0, 0)] for touch in decoder.feed(0, 0, *event)]
    return [(touch.touch_id, touch.kind) for touch in found]


def test_distance_that_becomes_0_is_down_and_one_that_leaves_0_is_up():
    decoder = SlotDecoder(AXES)
    assert fed(decoder, (3, TID, 7), (3, X, 400), (3, Y, 800), (3, DISTANCE, 1)) == []
    assert fed(decoder, (3, X, 440)) == []
    assert fed(decoder, (3, X, 480), (3, DISTANCE, 0), (1, codes.BTN_TOUCH, 1)) == [(1, "down")]
    assert fed(decoder, (3, X, 520)) == [(1, "move")]
    assert fed(decoder, (3, X, 560), (3, DISTANCE, 1), (1, codes.BTN_TOUCH, 0)) == [(1, "up")]
    assert fed(decoder, (3, X, 400)) == []
    assert fed(decoder, (3, TID, -1)) == []


def test_a_panel_that_tells_hovering_by_its_key_alone():
    decoder = SlotDecoder(AXES, ask_key=lambda: False)
    assert fed(decoder, (3, TID, 7), (3, X, 400), (3, Y, 800)) == []
    assert fed(decoder, (1, codes.BTN_TOUCH, 1)) == [(1, "down")]
    assert fed(decoder, (1, codes.BTN_TOUCH, 0)) == [(1, "up")]


def test_a_panel_that_tells_hovering_by_its_pressure_alone():
    """Once it has told a pressure above 0, a finger of 0 is above the glass, also the next one."""
    pressure = codes.ABS_MT_PRESSURE
    decoder = SlotDecoder(AXES)
    begins = (3, TID, 7), (3, X, 400), (3, Y, 800)
    assert fed(decoder, *begins, (3, pressure, 40), (1, codes.BTN_TOUCH, 1)) == [(1, "down")]
    assert fed(decoder, (3, X, 440), (3, pressure, 0)) == [(1, "up")]
    assert fed(decoder, (3, X, 480)) == []
    assert fed(decoder, (3, pressure, 30)) == [(1, "down")]
    assert fed(decoder, (3, TID, -1), (1, codes.BTN_TOUCH, 0)) == [(1, "up")]
    assert fed(decoder, (3, TID, 8), (3, X, 440), (3, pressure, 0), (1, codes.BTN_TOUCH, 1)) == []
    assert fed(decoder, (3, pressure, 20)) == [(1, "down")]


def test_fingers_of_protocol_a_keep_their_numbers_when_they_change_places_in_the_report():
    decoder = SlotDecoder(AXES, protocol="A")

    def report(*places):
        rows = [((3, X, x), (3, Y, y), (0, codes.SYN_MT_REPORT, 0)) for x, y in places]
        return fed(decoder, *(event for row in rows for event in row))

    assert report((100, 100), (2000, 1000)) == [(1, "down"), (2, "down")]
    assert report((2010, 1000), (110, 100)) == [(1, "move"), (2, "move")]
    assert decoder.axes.place_mm(110, 100) in places(decoder)
    # The first leaves; the other is not taken for it, and a new one has the number that is free.
    assert report((2020, 1000)) == [(1, "up"), (2, "move")]
    assert report((110, 100), (2030, 1000)) == [(2, "move"), (1, "down")]
    assert fed(decoder, (0, codes.SYN_MT_REPORT, 0)) == [(2, "up"), (1, "up")]
