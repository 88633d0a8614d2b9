"""Recordings of touch panels, as the tools write them, read as touches."""

import json

import numpy as np
import pytest

from haptix import InputError, Texture
from haptix.base.errors import FileFormatError
from haptix.play.simulation import Setting
from haptix.play.touch import is_recording, paths_of, read_events, read_recording
from haptix.play.touch.hid import HidReports
from tests.command_line import run_haptix
from tests.devices.guest.hid_panel import descriptor

# Two strokes of one finger by protocol B: 20 units per mm, and a pause in which it is lifted.
STEPS = [
    (0.00, [(3, 0x39, 12), (3, 0x35, 400), (3, 0x36, 800), (1, 0x14A, 1), (0, 0, 0)]),
    (0.01, [(3, 0x35, 420), (0, 0, 0)]),
    (0.02, [(3, 0x39, -1), (1, 0x14A, 0), (0, 0, 0)]),
    (0.50, [(3, 0x39, 13), (3, 0x35, 900), (1, 0x14A, 1), (0, 0, 0)]),
    (0.51, [(3, 0x36, 840), (0, 0, 0)]),
]
FOUND = [
    (0.00, 1, 20.0, 40.0, "down"),
    (0.01, 1, 21.0, 40.0, "move"),
    (0.02, 1, 21.0, 40.0, "up"),
    (0.50, 1, 45.0, 40.0, "down"),
    (0.51, 1, 45.0, 42.0, "move"),
    (0.51, 1, 45.0, 42.0, "up"),  # it was recorded no longer
]
AXES = {0x2F: (9, 0), 0x35: (4095, 20), 0x36: (2303, 20), 0x39: (65535, 0)}
NAMES = {
    **{0x2F: "ABS_MT_SLOT", 0x35: "ABS_MT_POSITION_X", 0x36: "ABS_MT_POSITION_Y"},
    **{0x39: "ABS_MT_TRACKING_ID", 0x14A: "BTN_TOUCH"},
}


def events():
    return [(t + 7.0, *event) for t, each in STEPS for event in each]


def evemu(resolution=True):
    """As `evemu-record` of evemu 2.7 writes it."""
    lines = ["# EVEMU 1.3", "N: Made-up Panel", "I: 0003 1234 5678 0111", "P: 02 00 00 00"]
    lines += ["B: 00 0b 00 00", "B: 01 " + "00 " * 41 + "04"]
    lines += [
        f"A: {code:02x} 0 {high} 0 0{f' {res}' * resolution}" for code, (high, res) in AXES.items()
    ]
    lines += [f"E: {t:.6f} {k:04x} {c:04x} {v:04d}\t# a comment" for t, k, c, v in events()]
    return "\n".join(lines)


def libinput():
    """As `libinput record` of 1.26 writes it, of a keyboard beside the panel too."""
    keyboard = "- node: /dev/input/event1\n  evdev:\n    codes:\n      1: [1, 2]\n  events:\n"
    keyboard += "  - evdev:\n    - [  7,      0,   1,  30,       1] # EV_KEY / KEY_A\n"
    panel = "- node: /dev/input/event7\n  evdev:\n    codes:\n      1: [330] # EV_KEY\n"
    panel += "      3: [47, 53, 54, 57] # EV_ABS\n    absinfo:\n"
    panel += "".join(f"      {c}: [0, {high}, 0, 0, {res}]\n" for c, (high, res) in AXES.items())
    panel += "    properties: [1]\n  udev:\n    properties:\n    - ID_INPUT=1\n  events:\n"
    for t, k, c, v in events():
        sec, usec = int(t), round(t % 1 * 1e6)
        panel += f"  - evdev:\n    - [{sec:3d}, {usec:6d}, {k:3d}, {c:3d}, {v:7d}] # a comment\n"
    return f"# libinput record\nversion: 1\nndevices: 2\nlibinput:\n  version: 1\n{keyboard}{panel}"


def getevent(labels):
    """As Android's `getevent -lp; getevent -lt` writes it, or without labels."""
    lines = ["add device 1: /dev/input/event2", '  name:     "panel"', "  events:"]
    lines += ["    KEY (0001): BTN_TOUCH" if labels else "    KEY (0001): 014a "]
    for code, (high, res) in AXES.items():
        name = f"{NAMES[code]:21}" if labels else f"{code:04x} "
        about = f"value 0, min 0, max {high}, fuzz 0, flat 0, resolution {res}"
        lines.append(f"    ABS (0003): {name} : {about}")
    for t, k, c, v in events():
        words = [f"{k:04x}", f"{c:04x}", f"{v & 0xFFFFFFFF:08x}"]
        if labels:
            words[0] = {0: "EV_SYN", 1: "EV_KEY", 3: "EV_ABS"}[k]
            words[1] = NAMES.get(c, "SYN_REPORT")
            words[2] = {1: "DOWN", 0: "UP"}[v] if k == 1 else words[2]
        lines.append("[{:15.6f}] /dev/input/event2: {:12} {:20} {}".format(t, *words))
    return "\n".join(lines)


def hid():
    """As `hid-recorder` of hid-tools writes it, of a panel of 4095 places on 204.7 mm."""
    report = descriptor(2047, 1151)
    lines = ["D: 0", f"R: {len(report)} {report.hex(' ')}", "N: panel", "I: 3 1209 7777"]

    def told(t, tip, x, y):
        data = [1, tip | 2, 5, x & 255, x >> 8, y & 255, y >> 8, 1, 0, 0]
        lines.append(f"E: {t:013.6f} {len(data)} " + " ".join(f"{byte:02x}" for byte in data))

    told(7.00, 1, 400, 800)
    told(7.01, 1, 420, 800)
    told(7.02, 0, 420, 800)
    return "\n".join(lines)


RECORDINGS = {
    "evemu": evemu, "libinput": libinput, "getevent -l": lambda: getevent(True),
    "getevent": lambda: getevent(False),
}  # fmt: skip


def write(tmp_path, text):
    path = tmp_path / "recording"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("name", RECORDINGS)
def test_a_recording_is_read_as_touches(tmp_path, name):
    path = write(tmp_path, RECORDINGS[name]())
    assert is_recording(path)
    found = read_events(path)
    assert [event[1:5] for event in found] == [event[1:] for event in FOUND]
    assert [event.t_s for event in found] == pytest.approx([event[0] for event in FOUND])


def test_hid_reports_are_read_by_their_descriptor(tmp_path):
    found = read_events(write(tmp_path, hid()))
    assert [event.kind for event in found] == ["down", "move", "up"]
    # The size is that of the descriptor, which the kernel would round.
    assert found[1].x_mm == pytest.approx(420 * 204.7 / 4095)
    assert found[1].y_mm == pytest.approx(800 * 115.1 / 4095)


@pytest.mark.parametrize("at", [1, 5])
def test_a_line_of_hid_that_lost_a_byte_is_refused(tmp_path, at):
    lines = hid().splitlines()
    lines[at] = lines[at].rsplit(" ", 1)[0]
    with pytest.raises(FileFormatError, match=r"cut off: expected \d+ bytes, got \d+"):
        read_recording(write(tmp_path, "\n".join(lines)))


def test_a_descriptor_repeats_no_values_without_bound():
    """Of 1.2 kB it made 3.7 million values; Linux bounds a report."""
    values = "96ff2f" + 300 * "0942 8102"
    with pytest.raises(FileFormatError, match="at most 12288 values in all reports"):
        HidReports.of(bytes.fromhex(f"050d 0904 a101 8501 1500 2501 7501 {values} c0"))


# Bits of a finger: tip switch, padding; contact identifier; then two places of 16 bits, 0 to 999.
TIP = "0942 1500 2501 7501 9501 8102 9507 8103"
CONTACT = "0951 25ff 7508 9501 8102"
PLACE = "0501 16000026e703 7510 9501 0930 8102 0931 8102 050d"
COUNT = "0954 1500 257f 7508 9501 8102"
FINGER, END = "0922 a102", "c0"
PLACED = f"{FINGER} {TIP} {CONTACT} {PLACE} {END}"


def of_hid(tmp_path, descriptor_hex, reports):
    """Return (kind, number from 0, x) of what is read from reports: (tip, id, x), and a count."""
    told = bytes.fromhex(f"050d 0904 a101 8501 {descriptor_hex} c0")
    lines = ["D: 0", f"R: {len(told)} {told.hex(' ')}", "I: 3 1209 7777"]
    for number, (fingers, count) in enumerate(reports):
        data = [1]
        for tip, touch_id, x in fingers:
            data += [tip, touch_id, x & 255, x >> 8, 100, 0]
        data += [] if count is None else [count]
        lines.append(f"E: {number / 100:.6f} {len(data)} " + " ".join(f"{b:02x}" for b in data))
    found = read_recording(write(tmp_path, "\n".join(lines)), 999.0, 999.0)
    return [(each.kind, each.touch_id - 1, each.x_mm) for each in found]


# Reports as those of panels in github.com/bentiss/hid-devices, which Linux reads so.
def test_a_panel_that_reports_one_finger_at_a_time_keeps_the_other_down(tmp_path):
    reports = [([(1, 0, 10)], None), ([(1, 1, 90)], None)] * 3 + [([(0, 0, 10)], None)]
    found = of_hid(tmp_path, PLACED, reports)  # eGalax, Data Modul, Zytronic
    kinds = [each[0] for each in found]
    assert kinds.count("down") == kinds.count("up") == 2
    assert [each[1:] for each in found if each[0] == "up"] == [(0, 10), (1, 90)]


def test_a_frame_of_two_reports_that_both_state_its_count(tmp_path):
    both = [([(1, 0, 10)], 2), ([(1, 1, 90)], 2)]
    found = of_hid(tmp_path, f"{PLACED} {COUNT}", 3 * both)  # TopSeed
    assert [each[0] for each in found] == ["down"] * 2 + ["move"] * 4 + ["up"] * 2


def test_a_frame_of_two_reports_of_which_the_first_states_its_count(tmp_path):
    first, second = [(1, 0, 10), (1, 1, 50)], [(1, 2, 90), (0, 0, 0)]
    found = of_hid(tmp_path, f"{PLACED} {PLACED} {COUNT}", [(first, 3), (second, 0)] * 2)
    assert [each for each in found if each[0] == "down"] == [
        *(("down", 0, 10), ("down", 1, 50), ("down", 2, 90))
    ]
    assert [each[0] for each in found].count("up") == 3


def test_a_finger_that_frames_no_longer_state_goes_up(tmp_path):
    frames = [([(1, 0, 10), (1, 1, 90)], 2)] + [([(1, 0, 10), (0, 0, 0)], 1)] * 20
    found = of_hid(tmp_path, f"{PLACED} {PLACED} {COUNT}", frames)
    assert found.index(("up", 1, 90)) < len(found) - 5


def test_places_in_a_collection_of_their_own_are_of_the_finger_around_it(tmp_path):
    inner = f"{FINGER} {TIP} {CONTACT} a100 {PLACE} {END} {END}"
    found = of_hid(tmp_path, f"{inner} {inner} {COUNT}", [([(1, 0, 10), (1, 1, 90)], 2)] * 2)
    assert found[:2] == [("down", 0, 10), ("down", 1, 90)]  # LG Display, Advanced Silicon


def test_fingers_that_are_physical_collections_only(tmp_path):
    finger = f"a100 {CONTACT} {PLACE} {TIP} {END}"
    told = bytes.fromhex(f"050d 0904 a101 8501 {FINGER} {finger} {finger} {COUNT} c0 c0")
    lines = ["D: 0", f"R: {len(told)} {told.hex(' ')}", "E: 0.0 14 01 00 0a 00 64 00 01"]
    lines[-1] += " 01 5a 00 64 00 01 02"
    found = read_recording(write(tmp_path, "\n".join(lines)), 999.0, 999.0)
    assert [each.x_mm for each in found if each.kind == "down"] == [10, 90]  # IRTOUCH


@pytest.mark.parametrize(
    ("field", "words"),
    [
        ("1a00000000 2affffff7f", "at most 12288 usages"),
        ("0930 9700ffffff 8102", "at most 12288 values"),
        ("0930 7611ff 8102", "at most 256 bits"),
    ],
)
def test_a_descriptor_of_more_than_linux_takes_is_refused(tmp_path, field, words):
    with pytest.raises(FileFormatError, match=words):
        of_hid(tmp_path, f"{PLACED} {field}", [([(1, 0, 10)], None)])


def test_a_finger_without_a_place_is_none(tmp_path):
    halves = PLACE.replace("0931", "0932")
    found = of_hid(tmp_path, f"{PLACED} {FINGER} {TIP} {CONTACT} {halves} {END}",
                   [([(1, 0, 10), (1, 1, 90)], None)])  # fmt: skip
    assert [each[0] for each in found] == ["down", "up"]


def test_a_size_of_an_impossible_exponent_is_asked_for(tmp_path):
    text = hid().replace("55 0e", "55 7f")
    assert text != hid()
    with pytest.raises(InputError, match="size"):
        read_recording(write(tmp_path, text))


def test_the_size_is_asked_for_where_the_recording_states_none(tmp_path):
    path = write(tmp_path, evemu(resolution=False))
    with pytest.raises(InputError, match=r"recording: the driver gives no size.*width_mm"):
        read_recording(path)
    assert read_recording(path, 204.75, 115.15)[0].x_mm == pytest.approx(20.0)


def test_a_panel_that_lies_turned(tmp_path):
    first = read_recording(write(tmp_path, evemu()), matrix="turn-180")[0]
    assert (first.x_mm, first.y_mm) == pytest.approx((204.75 - 20, 115.15 - 40))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t_s,x_mm,y_mm\n0,1,2\n", "libinput record, evemu-record, getevent"),
        ("E: 0.1 0003 0035 0400\nE: 0.1 0000 0000 0000", "axes of a touch panel"),
        ("[  1.0] /dev/input/event2: 0003 0035 00000190", "getevent -lp"),
        (evemu().replace("0035 0400", "0035 4" + 400 * "0"), "cut off"),
        (evemu().replace("0039 0012", "0039 -001").replace("0039 0013", "0039 -001"), "one touch"),
    ],
)
def test_what_is_no_recording_says_what_is_missing(tmp_path, text, words):
    with pytest.raises(FileFormatError, match=words) as caught:
        read_recording(write(tmp_path, text))
    assert str(tmp_path) in str(caught.value)


def test_the_path_of_a_finger_that_lifts(tmp_path):
    [path] = paths_of(read_events(write(tmp_path, evemu())), normal_force_n=0.3)
    assert path.normal_force_n.tolist() == [0.3, 0.3, 0.0, 0.0, 0.3, 0.3, 0.0]
    assert path.at(0.3)[2] == 0.0
    assert [float(each) for each in path.at(0.505)[:2]] == pytest.approx([45.0, 41.0])


def test_fingers_that_are_down_together_have_a_path_each():
    rows = [(0.0, 1), (0.1, 1), (0.1, 2), (0.2, 2)]
    from haptix.play.touch import TouchEvent

    events_ = [TouchEvent(t, n, 10.0 * n, 5.0, "move") for t, n in rows]
    assert [path.x_mm[0] for path in paths_of(events_)] == [10.0, 20.0]


def test_a_recording_is_rendered_with_its_lifted_part_without_drive(tmp_path):
    text = evemu()
    t = np.arange(0.0, 0.6, 0.01)
    lines = [line for line in text.splitlines() if not line.startswith("E:")]
    for i, t_s in enumerate(t):
        if i in (0, 30):
            lines += [f"E: {t_s:.6f} 0003 0039 {i + 1:04d}", f"E: {t_s:.6f} 0003 0036 0400"]
            lines += [f"E: {t_s:.6f} 0001 014a 0001"]
        if i == 20:
            lines += [f"E: {t_s:.6f} 0003 0039 -001", f"E: {t_s:.6f} 0001 014a 0000"]
        if not 20 < i < 30:
            lines += [f"E: {t_s:.6f} 0003 0035 {200 + 20 * i:04d}", f"E: {t_s:.6f} 0000 0000 0000"]
    path = write(tmp_path, "\n".join(lines))
    [finger] = paths_of(read_events(path))
    import haptix
    from haptix.play.render import Renderer

    device = haptix.open_device("mock:pace=virtual")
    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    surface, _ = Setting(model, Texture(np.ones((2, 2)), 100.0), finger).surface()
    texture = Texture(np.ones((2, 2)), width_mm=100.0, beyond="hold")
    with Renderer(surface, texture, device) as renderer:
        renderer.play(finger)
    volts = np.abs(device.mock.played_v)
    rate = renderer.sample_rate_hz
    assert volts[: int(0.18 * rate)].max() > 100 < volts[int(0.4 * rate) : int(0.5 * rate)].max()
    assert volts[int(0.22 * rate) : int(0.29 * rate)].max() == 0.0


def test_the_command_plays_a_recording(tmp_path):
    path = write(tmp_path, evemu())
    played = run_haptix("play", "--trajectory", path, "--material", "gallery:basket", "--json")
    assert played.code == 0, played.err
    assert json.loads(played.out)[0]["seconds"] > 0.4
