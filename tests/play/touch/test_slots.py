"""Linux multi-touch events, as bytes that a device file gives."""

import math
import struct

import pytest

from haptix import InputError
from haptix.play.touch import AxisRange, ScreenAxes, SlotDecoder, Touches
from haptix.play.touch import touchscreen as codes

# A screen of 160 x 90 mm with 20 and 25 units per mm, whose x starts at 100.
AXES = ScreenAxes(AxisRange(100, 3300, 20.0), AxisRange(0, 2250, 25.0), force_n_per_unit=0.01)

# As evemu-record writes them: time, type and code (hexadecimal), value, and what it is.
RECORDING = """
E: 12.000000 0003 0039 0045  ABS_MT_TRACKING_ID
E: 12.000000 0003 0035 0900  ABS_MT_POSITION_X
E: 12.000000 0003 0036 0500  ABS_MT_POSITION_Y
E: 12.000000 0003 0030 0160  ABS_MT_TOUCH_MAJOR
E: 12.000000 0003 0031 0120  ABS_MT_TOUCH_MINOR
E: 12.000000 0003 003a 0050  ABS_MT_PRESSURE
E: 12.000000 0001 014a 0001  BTN_TOUCH
E: 12.000000 0003 0000 0900  ABS_X
E: 12.000000 0000 0000 0000  SYN_REPORT
E: 12.010000 0003 0035 0920  ABS_MT_POSITION_X
E: 12.010000 0000 0000 0000  SYN_REPORT
E: 12.020000 0003 0035 0940  ABS_MT_POSITION_X
E: 12.020000 0003 002f 0001  ABS_MT_SLOT 1
E: 12.020000 0003 0039 0046  ABS_MT_TRACKING_ID
E: 12.020000 0003 0035 2100  ABS_MT_POSITION_X
E: 12.020000 0003 0036 1000  ABS_MT_POSITION_Y
E: 12.020000 0003 003a 0030  ABS_MT_PRESSURE
E: 12.020000 0000 0000 0000  SYN_REPORT
E: 12.030000 0003 0036 1025  ABS_MT_POSITION_Y
E: 12.030000 0003 002f 0000  ABS_MT_SLOT 0
E: 12.030000 0003 0039 -001  ABS_MT_TRACKING_ID
E: 12.030000 0000 0000 0000  SYN_REPORT
E: 12.040000 0003 0039 0047  ABS_MT_TRACKING_ID, slot 0 again, y where it was
E: 12.040000 0003 0035 0700  ABS_MT_POSITION_X
E: 12.040000 0000 0000 0000  SYN_REPORT
"""


def event(t_s, kind, code, value):
    return struct.pack("llHHi", int(t_s), round((t_s % 1) * 1e6), kind, code, value)


def recorded(text=RECORDING):
    data = b""
    for row in text.strip().splitlines():
        _, t, kind, code, value, *_ = row.split()
        data += event(float(t), int(kind, 16), int(code, 16), int(value))
    return data


def pieces(data, *lengths):
    while data:
        for length in lengths:
            yield data[:length]
            data = data[length:]


def test_a_recording():
    found = SlotDecoder(AXES).feed_bytes(recorded())
    area = math.pi / 4 * (160 / 20e3) * (120 / 20e3)
    wanted = [
        # x = (900 - 100) / 20, y = 500 / 25; 50 units of pressure of 0.01 N.
        (12.00, 1, 40.0, 20.0, "down", 0.5, area),
        (12.01, 1, 41.0, 20.0, "move", 0.5, area),
        (12.02, 1, 42.0, 20.0, "move", 0.5, area),
        (12.02, 2, 100.0, 40.0, "down", 0.3, None),
        (12.03, 1, 42.0, 20.0, "up", 0.5, area),
        (12.03, 2, 100.0, 41.0, "move", 0.3, None),
        # What slot 0 did not say again is as it was.
        (12.04, 1, 30.0, 20.0, "down", 0.5, area),
        (12.04, 2, 100.0, 41.0, "move", 0.3, None),
    ]
    assert [event[1:5] for event in found] == [row[1:5] for row in wanted]
    for event_, row in zip(found, wanted, strict=True):
        assert event_.t_s == pytest.approx(row[0], abs=1e-9)
        assert event_.normal_force_n == pytest.approx(row[5])
        assert event_.contact_area_m2 == (None if row[6] is None else pytest.approx(row[6]))


@pytest.mark.parametrize("lengths", [(1,), (24,), (7, 31, 100)])
def test_bytes_in_any_pieces(lengths):
    decoder = SlotDecoder(AXES)
    found = [t for piece in pieces(recorded(), *lengths) for t in decoder.feed_bytes(piece)]
    assert found == SlotDecoder(AXES).feed_bytes(recorded())


def test_touches_take_it_whole():
    touches = Touches(strict=True)
    for touch in SlotDecoder(AXES).feed_bytes(recorded()):
        touches.push(touch)
    assert {touch_id for touch_id, _ in touches.active} == {1, 2}
    assert touches.counts.without_down == touches.counts.without_up == 0


def frame(t_s, *values):
    return b"".join(event(t_s, codes.EV_ABS, code, value) for code, value in values) + event(
        t_s, codes.EV_SYN, codes.SYN_REPORT, 0
    )


def down(t_s, slot, touch_id, x=900, y=500):
    return frame(
        t_s,
        (codes.ABS_MT_SLOT, slot),
        (codes.ABS_MT_TRACKING_ID, touch_id),
        (codes.ABS_MT_POSITION_X, x),
        (codes.ABS_MT_POSITION_Y, y),
    )


def kinds(touches):
    return [(touch.touch_id, touch.kind) for touch in touches]


def test_a_resting_finger_is_reported_with_the_others():
    decoder = SlotDecoder(AXES)
    decoder.feed_bytes(down(0, 0, 1) + down(0, 1, 2))
    moved = decoder.feed_bytes(frame(0.01, (codes.ABS_MT_POSITION_X, 950)))
    assert kinds(moved) == [(1, "move"), (2, "move")]
    assert moved[0].x_mm == 40.0 and moved[1].x_mm == 42.5


def test_one_finger_for_another_in_one_slot_without_a_lift_between():
    decoder = SlotDecoder(AXES)
    decoder.feed_bytes(down(0, 0, 1))
    assert kinds(decoder.feed_bytes(down(0.01, 0, 2))) == [(1, "up"), (2, "down")]


def test_the_kernel_s_ids_without_end_become_numbers_that_the_service_takes():
    """The kernel counts touches from the start of the machine, up to 65535."""
    decoder, found = SlotDecoder(AXES), []
    for i in range(600):
        found += decoder.feed_bytes(down(i, i % 2, 64_000 + i))  # two fingers, in turns
    assert {touch.touch_id for touch in found} == {1, 2, 3}
    active = set()
    for touch in found:
        assert (touch.touch_id in active) == (touch.kind != "down")
        (active.discard if touch.kind == "up" else active.add)(touch.touch_id)
    assert len(active) == 2


def test_a_palm_is_no_touch():
    decoder = SlotDecoder(AXES)
    decoder.feed_bytes(down(0, 0, 1))
    palm = decoder.feed_bytes(frame(0.01, (codes.ABS_MT_TOOL_TYPE, codes.MT_TOOL_PALM)))
    assert kinds(palm) == [(1, "up")]
    assert decoder.feed_bytes(frame(0.02, (codes.ABS_MT_POSITION_X, 950))) == []


def test_a_touch_without_a_place_waits_for_one():
    decoder = SlotDecoder(AXES)
    assert decoder.feed_bytes(frame(0, (codes.ABS_MT_TRACKING_ID, 1))) == []
    assert decoder.feed_bytes(frame(0.01, (codes.ABS_MT_POSITION_X, 900))) == []
    assert kinds(decoder.feed_bytes(frame(0.02, (codes.ABS_MT_POSITION_Y, 500)))) == [(1, "down")]


DROPPED = event(0.01, codes.EV_SYN, codes.SYN_DROPPED, 0)


def test_dropped_events_lift_everything():
    decoder = SlotDecoder(AXES)
    decoder.feed_bytes(down(0, 0, 1) + down(0, 1, 2))
    # What follows up to the report is half a frame: of no use.
    found = decoder.feed_bytes(DROPPED + frame(0.01, (codes.ABS_MT_POSITION_X, 3000)))
    assert kinds(found) == [(1, "up"), (2, "up")]
    assert decoder.dropped == 1
    assert kinds(decoder.feed_bytes(down(0.02, 0, 3))) == [(1, "down")]


def test_dropped_events_are_asked_for():
    now = [(0, {0: {}})]
    decoder = SlotDecoder(AXES, lambda: now[-1])
    decoder.feed_bytes(down(0, 0, 1) + down(0, 1, 2))
    x, y, tracking = codes.ABS_MT_POSITION_X, codes.ABS_MT_POSITION_Y, codes.ABS_MT_TRACKING_ID
    # Meanwhile 1 has moved, 2 was lifted, and 3 came down in its slot; slot 0 is the current one.
    now.append((0, {0: {tracking: 1, x: 1100, y: 500}, 1: {tracking: 3, x: 100, y: 0}}))
    found = decoder.feed_bytes(DROPPED + frame(0.01, (codes.ABS_MT_SLOT, 1), (tracking, -1)))
    assert kinds(found) == [(2, "up"), (1, "move"), (3, "down")]
    assert found[1].x_mm == 50.0
    assert decoder.feed_bytes(frame(0.02, (x, 1300)))[0].x_mm == 60.0


def test_fingers_that_were_down_at_the_start():
    x, y, tracking = codes.ABS_MT_POSITION_X, codes.ABS_MT_POSITION_Y, codes.ABS_MT_TRACKING_ID
    decoder = SlotDecoder(AXES, lambda: (1, {0: {tracking: -1}, 1: {tracking: 8, x: 900, y: 500}}))
    found = decoder.feed_bytes(frame(0, (x, 940)))
    assert [touch[1:5] for touch in found] == [(1, 42.0, 20.0, "down")]


def test_pressure_and_area_without_calibration():
    plain = ScreenAxes(AXES.x, AXES.y, area_units_per_mm=10.0)
    touch = SlotDecoder(plain).feed_bytes(recorded())[0]
    assert touch.normal_force_n is None
    assert touch.contact_area_m2 == pytest.approx(math.pi / 4 * 16e-3 * 12e-3)
    # Without a minor axis it is a circle.
    rows = [row for row in RECORDING.splitlines() if " 0031 " not in row]
    touch = SlotDecoder(plain).feed_bytes(recorded("\n".join(rows)))[0]
    assert touch.contact_area_m2 == pytest.approx(math.pi / 4 * 16e-3**2)


def test_noise_on_the_line_does_not_stop_it():
    decoder = SlotDecoder(AXES)
    touches = Touches()
    for i in range(0, 24 * 400):
        data = bytes((i * 7919 + j * 104729) % 251 for j in range(24))
        for touch in decoder.feed_bytes(data):
            touches.push(touch)
    assert decoder.feed_bytes(b"") == []


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: AxisRange(10, 10, 5.0), "low < high"),
        (lambda: AxisRange(0, 10, 0.0), "units per mm"),
        (lambda: AxisRange(0, 10, math.nan), "units per mm"),
        (lambda: ScreenAxes(AXES.x, AXES.y, force_n_per_unit=0.0), "force_n_per_unit"),
        (lambda: ScreenAxes(AXES.x, AXES.y, area_units_per_mm=-1.0), "area_units_per_mm"),
    ],
)
def test_axes_that_cannot_be(make, word):
    with pytest.raises(InputError, match=word):
        make()
