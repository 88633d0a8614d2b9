"""The page "Play" before a front whose engine writes down touches, and is told what they feel."""

import itertools
import json
import re

import numpy as np
import pytest
from fastapi import APIRouter

from haptix.service.protocol.batches import TelemetryFrame, write_frame
from tests.studio.conftest import a_front, a_page, address, keep, violations
from tests.waiting import wait_for

STEP_S = 0.001
BEGINS_S = itertools.count(1000.0, 10.0)  # of strokes that are told of: each is a finger's new one


@pytest.fixture(scope="module")
def front(tmp_path_factory):
    routes = APIRouter()
    routes.get("/v1/drive")(lambda: DRIVE)
    with a_front(tmp_path_factory.mktemp("service"), routes) as service:
        service.hub.profiles = PROFILES
        yield service


@pytest.fixture(scope="module")
def opened(front, browser):
    with a_page(browser) as page:
        page.goto(address(front))
        page.locator('.output[data-state="armed"]').wait_for()
        page.locator(".uplot").first.wait_for()
        yield page


@pytest.fixture
def play(front, opened):
    """The page, armed, with nothing touched; one for all tests."""
    front.engine.reports.clear()
    return opened


def tell(front, felt_of_wanted, count=600, wanted=0.30, touch_id=0):
    """Tell of a finger that slid along y = 17 mm over the first region, and what it felt."""
    t0_s = next(BEGINS_S)
    x_mm = np.linspace(10, 50, count)
    friction = np.tile([0, 17, 0.5, wanted, wanted, 0.25, 0.33, 0.6], (count, 1))
    friction[:, 0] = x_mm
    mu = felt_of_wanted * wanted
    for stream, rows in (("friction", friction), ("felt", np.tile([mu, 0.5 * mu], (count, 1)))):
        for first in range(0, count, 50):
            part, at_s = rows[first : first + 50], t0_s + first * STEP_S
            frame = TelemetryFrame(stream, touch_id, 1 + first // 50, 0, at_s, STEP_S, part)
            front.hub.on_telemetry(write_frame(frame))
            # A client is sent the newest four frames only.
            wait_for(lambda: not any(session._full for session in front.hub.sessions.values()))


def place(page, x_mm, y_mm):
    """Where a place of the layout is on the page: the board shows 0 to 116 mm with 4 mm around."""
    box = page.locator(".board").bounding_box()
    scale = min(box["width"] / 124, box["height"] / 64)
    left = box["x"] + (box["width"] - 124 * scale) / 2 + 4 * scale
    top = box["y"] + (box["height"] - 64 * scale) / 2 + 4 * scale
    return left + x_mm * scale, top + y_mm * scale


def slide(page, start_mm, end_mm, steps=10):
    page.mouse.move(*place(page, *start_mm))
    page.mouse.down()
    page.mouse.move(*place(page, *end_mm), steps=steps)
    page.mouse.up()


def test_a_slide_is_touches_in_millimetres_with_the_force_that_is_said(front, play):
    slide(play, (10, 17), (50, 17))
    wait_for(lambda: front.engine.reports and front.engine.reports[-1].kind == "up")
    reports = front.engine.reports
    assert [reports[0].kind, reports[-1].kind] == ["down", "up"]
    # Pixels of a mouse are whole: half of one is 0.07 mm here.
    assert reports[0].x_mm == pytest.approx(10, abs=0.1)
    assert reports[-1].x_mm == pytest.approx(50, abs=0.1)
    assert {report.normal_force_n for report in reports[:-1]} == {0.5}
    front.engine.reports.clear()
    force = play.get_by_label("Normal force", exact=True)
    force.select_option("assumed")
    slide(play, (10, 17), (50, 17))
    wait_for(lambda: front.engine.reports and front.engine.reports[-1].kind == "up")
    force.select_option("slider")
    assert {report.normal_force_n for report in front.engine.reports} == {None}


def test_a_slide_over_a_zoomed_board_has_its_true_places(front, play):
    play.get_by_role("button", name="Zoom in").click()
    play.locator(".zoom", has_text="150 %").wait_for()

    def zoomed(x_mm, y_mm):  # about the middle of the layout
        return 58 + 1.5 * (x_mm - 58), 28 + 1.5 * (y_mm - 28)

    try:
        slide(play, zoomed(30, 20), zoomed(70, 36))
        wait_for(lambda: front.engine.reports and front.engine.reports[-1].kind == "up")
        reports = front.engine.reports
        assert [reports[0].x_mm, reports[0].y_mm] == pytest.approx([30, 20], abs=0.1)
        assert [reports[-1].x_mm, reports[-1].y_mm] == pytest.approx([70, 36], abs=0.1)
    finally:
        play.get_by_role("button", name=": Show all").click()
        play.locator(".zoom", has_text="100 %").wait_for()


@pytest.fixture
def hands(front, opened, browser):
    """A page that has taken over, and its input: touches and a pen, as Chromium emulates them."""
    context = browser.new_context(viewport={"width": 1280, "height": 800}, has_touch=True)
    page = context.new_page()
    errors = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    front.engine.reports.clear()
    page.goto(address(front))
    page.get_by_role("button", name="Take over").click()
    page.locator('.output[data-state="armed"]').wait_for()
    page.locator(".uplot").first.wait_for()
    yield page, context.new_cdp_session(page)
    context.close()
    opened.get_by_role("button", name="Arm").click()
    opened.locator('.output[data-state="armed"]').wait_for()
    assert not errors


def touch(hands, kind, **fingers):
    """Send the fingers that touch now, by number: x [mm], and force and radius where they say."""
    page, input = hands
    points = []
    for name, (x_mm, *rest) in fingers.items():
        x, y = place(page, x_mm, 17)
        more = dict(zip(("force", "radiusX"), rest, strict=False))
        points.append({"id": int(name[1:]), "x": x, "y": y, **more})
    input.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})


def kinds(front, touch_id):
    """What the engine was told of a finger, without repeated moves."""
    told = [report.kind for report in front.engine.reports if report.touch_id == touch_id]
    return [kind for kind, _ in itertools.groupby(told)]


def test_two_fingers_at_once(front, hands):
    for number in range(6):
        kind = "touchMove" if number else "touchStart"
        touch(hands, kind, f0=(10 + number,), f1=(70 + number,))
    touch(hands, "touchEnd")
    wait_for(lambda: [report.kind for report in front.engine.reports].count("up") == 2)
    for touch_id, first_mm in ((0, 10), (1, 70)):
        moved = [report for report in front.engine.reports if report.touch_id == touch_id][:-1]
        x_mm = [report.x_mm for report in moved]
        assert x_mm[0] == pytest.approx(first_mm, abs=0.1)
        assert x_mm == sorted(x_mm) and len(x_mm) > 2


def test_two_hands_of_which_one_lifts_and_a_palm_is_cancelled(front, hands):
    touch(hands, "touchStart", f0=(10,), f1=(70,))
    touch(hands, "touchStart", f0=(10,), f1=(70,), f2=(40, 0.9, 60))  # a palm comes down
    touch(hands, "touchEnd", f1=(70,))  # the right hand lifts
    wait_for(lambda: kinds(front, 1)[-1:] == ["up"])
    touch(hands, "touchMove", f0=(14,), f2=(42, 0.9, 60))
    wait_for(lambda: kinds(front, 0) == ["down", "move"])
    touch(hands, "touchStart", f0=(14,), f2=(42, 0.9, 60), f3=(60,))  # and comes down again
    wait_for(lambda: kinds(front, 1)[-2:] == ["up", "down"])
    touch(hands, "touchCancel")  # the system takes all for a palm
    wait_for(lambda: all(kinds(front, finger)[-1] == "up" for finger in range(3)))
    count = len(front.engine.reports)
    touch(hands, "touchStart", f7=(20,))
    wait_for(lambda: len(front.engine.reports) > count)
    assert front.engine.reports[count].touch_id == 0  # no number stays taken
    touch(hands, "touchEnd")
    wait_for(lambda: kinds(front, 0)[-1] == "up")


def test_the_pressure_of_a_tablet_and_of_a_pen_is_the_force(front, hands):
    page, input = hands
    page.get_by_label("Normal force", exact=True).select_option("pressure")
    touch(hands, "touchStart", f0=(10, 0.3))
    touch(hands, "touchMove", f0=(12, 0.6))
    touch(hands, "touchEnd")
    wait_for(lambda: kinds(front, 0)[-1:] == ["up"])
    told = {report.kind: report.normal_force_n for report in front.engine.reports[:-1]}
    assert told == {"down": pytest.approx(0.3, abs=0.01), "move": pytest.approx(0.6, abs=0.01)}
    front.engine.reports.clear()

    def pen(kind, x_mm, force, buttons):
        x, y = place(page, x_mm, 17)
        held = {"button": "left" if buttons or kind == "mouseReleased" else "none"}
        pen = {"pointerType": "pen", "force": force, "tiltX": 40, "tiltY": -20, **held}
        input.send("Input.dispatchMouseEvent", {"type": kind, "x": x, "y": y, "buttons": buttons,
                                                "clickCount": 1, **pen})  # fmt: skip

    pen("mouseMoved", 8, 0.0, 0)  # hovers
    pen("mousePressed", 10, 0.25, 1)
    pen("mouseMoved", 14, 0.8, 1)
    pen("mouseReleased", 14, 0.0, 0)
    pen("mouseMoved", 30, 0.0, 0)
    wait_for(lambda: kinds(front, 0) == ["down", "move", "up"])
    down, *_, move, up = front.engine.reports
    assert down.x_mm == pytest.approx(10, abs=0.1)
    assert down.normal_force_n == pytest.approx(0.25, abs=0.01)
    assert move.normal_force_n == pytest.approx(0.8, abs=0.01)
    assert up.kind == "up"  # and nothing was told of a pen that hovers


def test_arrow_keys_slide_at_sixty_millimetres_a_second(front, play):
    play.locator(".board").focus()
    play.keyboard.down("ArrowRight")
    wait_for(lambda: len(front.engine.reports) > 30)
    play.keyboard.up("ArrowRight")
    wait_for(lambda: front.engine.reports[-1].kind == "up")
    moves = front.engine.reports[:-1]
    t_s = np.array([report.t_s for report in moves])
    x_mm = np.array([report.x_mm for report in moves])
    assert np.polyfit(t_s, x_mm, 1)[0] == pytest.approx(60, rel=0.02)
    assert np.ptp([report.y_mm for report in moves]) == 0


def test_what_is_told_is_shown(front, play):
    def is_shown():
        tell(front, 1.03)  # a busy front passes on the newest frames only: it is told again
        return play.locator('[data-name="felt"] dd').inner_text() == "0.309"

    wait_for(is_shown)
    assert play.locator('[data-name="wanted"] dd').inner_text() == "0.300"
    assert play.locator('[data-name="force"] dd').inner_text().startswith("0.50 N")
    assert play.locator('[data-name="voltage"] dd').inner_text().startswith("60 %")
    # 40 mm in 0.6 s
    assert play.locator('[data-name="speed"] dd').inner_text() == "67 mm/s"
    # 3 % of 0.3 are 0.03 / 0.11 JND; all of it can be had here.
    bars = play.locator(".bar").all_inner_texts()
    assert [re.sub(r"\s+", " ", bar) for bar in bars] == [
        "Rendering 0.27 JND", "Out of reach 0.00 JND", "Total 0.27 JND",
    ]  # fmt: skip


def test_a_finger_that_got_no_drive_yet_ends_no_drawing(front, play):
    play.mouse.move(*place(play, 10, 10))
    play.mouse.down()
    none = np.full((1, 8), np.nan)
    frame = TelemetryFrame("friction", 7, 1, 0, next(BEGINS_S), STEP_S, none)
    front.hub.on_telemetry(write_frame(frame))
    play.wait_for_timeout(1200)  # each second it is said what is felt
    play.mouse.up()
    test_what_is_told_is_shown(front, play)


def test_an_exception_is_told_and_kept_and_drawing_goes_on(front, play, tmp_path):
    play.evaluate(
        """() => {
            const whole = Map.prototype.values;
            Map.prototype.values = function () {
                Map.prototype.values = whole;
                throw new RangeError("a picture is broken");
            };
        }"""
    )
    play.locator(".notice", has_text="a picture is broken").wait_for()
    test_what_is_told_is_shown(front, play)
    with play.expect_download() as download:
        play.get_by_role("button", name="Save a report").click()
    (fault,) = json.loads(download.value.path().read_text())["faults"]
    assert fault["sentence"] == "a picture is broken"
    assert "play.js" in fault["stack"]
    assert [error for error in play.expected_errors if "a picture is broken" not in error] == []
    play.expected_errors.clear()
    # A busy service may have told something of its own meanwhile.
    closes = play.get_by_role("button", name="Close")
    while closes.count():
        closes.first.click()


PIXEL = """([x, y]) => {
    const canvas = document.querySelectorAll(".board canvas")[1];
    const { left, top } = canvas.getBoundingClientRect();
    return [...canvas.getContext("2d").getImageData(x - left, y - top, 1, 1).data];
}"""


def test_the_trail_has_the_colour_of_its_error(front, play):
    for felt, wanted, color in [
        (1.01, 0.30, [0, 158, 115]),  # 0.09 JND
        (1.04, 0.30, [86, 180, 233]),  # 0.36 JND
        (1.08, 0.30, [230, 159, 0]),
        (1.20, 0.30, [213, 94, 0]),
        (0.90, 0.36, [204, 121, 167]),  # above what can be had
    ]:
        at = place(play, 31.5, 17)

        def is_drawn(felt=felt, wanted=wanted, color=color, at=at):
            # A busy page reads late and misses frames, as it should: it is told again.
            tell(front, felt, 300, wanted)
            play.wait_for_timeout(150)
            return play.evaluate(PIXEL, at) == [*color, 255]

        wait_for(is_drawn)


def test_a_stroke_is_recorded_replayed_and_kept(front, play):
    play.get_by_role("button", name="Record", exact=True).click()
    slide(play, (10, 17), (50, 17), steps=20)
    wait_for(lambda: front.engine.reports and front.engine.reports[-1].kind == "up")
    first = list(front.engine.reports)
    front.engine.reports.clear()
    play.get_by_role("button", name="Replay").click()
    wait_for(lambda: front.engine.reports and front.engine.reports[-1].kind == "up")
    again = front.engine.reports
    for field in ("kind", "touch_id", "x_mm", "y_mm"):
        values = [[getattr(report, field) for report in stroke[:-1]] for stroke in (first, again)]
        assert values[0] == (pytest.approx(values[1], abs=1e-3) if "mm" in field else values[1])
    times = [np.diff([report.t_s for report in stroke]) for stroke in (first, again)]
    # The front reads the page's clock by its pings, to milliseconds on a busy machine.
    assert np.median(np.abs(times[0] - times[1])) < 2e-3
    with play.expect_download() as download:
        play.get_by_role("button", name="Save CSV").click()
    table = np.genfromtxt(download.value.path(), delimiter=",", names=True)
    assert table.dtype.names == ("t_s", "x_mm", "y_mm", "normal_force_n")
    assert table["x_mm"] == pytest.approx([one.x_mm for one in first[:-1]], abs=1e-3)


@pytest.mark.slow  # its pauses are for people; what it is made of is tested above
def test_two_materials_by_the_same_stroke_blind(front, play):
    play.get_by_role("button", name="Record", exact=True).click()
    slide(play, (10, 17), (50, 17))
    play.get_by_text("Compare two materials").click()
    play.get_by_label("A", exact=True).select_option("Sand")
    play.get_by_label("B", exact=True).select_option("Button")
    play.get_by_label("blind").check()
    before = len(front.engine.told)
    play.get_by_role("button", name="Compare").click()
    assert play.get_by_text("Sand").count() == 2  # in both lists: nothing tells what plays
    play.get_by_role("button", name="No difference").click()
    play.get_by_text("You said: No difference").wait_for()
    assert play.locator(".told-comparison th").count() == 2

    def layouts():
        return [do for do, *_ in front.engine.told[before:] if do.startswith("layout")]

    wait_for(lambda: len(layouts()) >= 3)  # one, the other, and the document again
    assert not violations(play)


@pytest.mark.parametrize("page_name", ["play", "screens", "calibrate", "sit", "tasks"])
def test_anyone_can_use_it(front, play, page_name):
    play.evaluate("(name) => { location.hash = `#/${name}`; }", page_name)
    play.locator(f"main.{page_name}").wait_for()
    for width, scheme in ((3840, "light"), (1440, "light"), (768, "light"), (360, "dark")):
        play.emulate_media(color_scheme=scheme)
        play.set_viewport_size({"width": width, "height": 800})
        overflow = play.evaluate("document.documentElement.scrollWidth - innerWidth")
        assert overflow <= 0, f"{width} px"
        assert width > 1440 or not violations(play), f"{width} px"
        keep(play, f"{page_name}-{width}")
    play.set_viewport_size({"width": 1280, "height": 800})
    play.evaluate("location.hash = '#/play'")
    play.locator(".board").wait_for()


PROFILES = {
    kind: {
        "name": kind, "source": "/a/long/path/of/a/profile/of/the/laboratory/screen.toml",
        "calibrated": "2026-11-01", "age_days": 21, "verdict": "provisional",
        "rests_on": ["the response of the finger"], "spread": {"insulator_thickness_m": 0.04},
        "warnings": ["screen 'bench 3' (its calibration is provisional)"],
        "verified": "0.2 to 0.8 N, up to 150 V",
        "document": {"name": kind, "insulator_thickness_m": 1e-6},
    }
    for kind in ("screen", "finger")
}  # fmt: skip


DRIVE = {
    "carrier_hz": 4000.0,
    "highest_v": 150.0,
    "normal_force_n": [0.1, 1.0],
    "current_a": [20e-6, 110e-6],
}


def test_what_plays_is_told_in_volts_and_amperes(front, play):
    play.get_by_role("link", name="Screens").click()
    # Six tenths of 150 V, and of 60 uA at 0.5 N, between 20 at 0.1 N and 110 at 1 N.
    wanted = ["90 V (60 %)"] * 3 + ["36 µA"]
    shown = play.locator(".readings dd")

    def is_shown():
        tell(front, 1.0, 100)  # a busy page misses frames: it is told again
        return shown.all_inner_texts()[:4] == wanted

    wait_for(is_shown)
    play.get_by_role("link", name="Play").click()


def test_a_profile_says_what_it_rests_on(front, play):
    play.get_by_role("link", name="Screens").click()
    play.get_by_text("2026-11-01, 21 days ago").first.wait_for()
    for words in ("the response of the finger", "its calibration is provisional", "4.0 %"):
        assert play.get_by_text(words).first.is_visible()
    play.get_by_role("button", name="STOP", exact=True).click()
    wait_for(lambda: front.engine.when("stop"))
    play.get_by_role("button", name="Arm").click()
    play.locator('.output[data-state="armed"]').wait_for()
    play.get_by_role("link", name="Play").click()


def test_a_real_driver_that_fails_says_what_to_do_until_it_is_armed(front, opened, browser):
    virtual = front.hub.inventory
    device = virtual.devices[0].model_copy(update={"is_real": True})
    front.hub.inventory = virtual.model_copy(update={"devices": (device,)})
    with a_page(browser) as page:
        page.goto(address(front))
        page.get_by_role("button", name="Take over").click()
        page.locator('.output[data-state="armed"]').wait_for()
        front.hub.on_engine_event({"event": "output", "state": "failed", "reason": "no answer"})
        page.get_by_text("no answer. Look after its cable and power, then press Arm.").wait_for()
        assert not violations(page)
        page.get_by_role("button", name="Arm").click()
        page.locator(".trouble").wait_for(state="hidden")
    front.hub.inventory = virtual
    opened.get_by_role("button", name="Arm").or_(
        opened.get_by_role("button", name="Take over")
    ).click()
    opened.locator('.output[data-state="armed"]').wait_for()


def test_a_driver_that_fails_says_why_and_a_virtual_one_is_armed_again(front, play):
    armed = len(front.engine.when("arm"))
    event = {"event": "output", "state": "failed", "reason": "the cable was pulled"}
    front.hub.on_engine_event(event)
    play.get_by_text("the cable was pulled").wait_for()
    wait_for(lambda: len(front.engine.when("arm")) > armed)


def test_the_board_is_to_scale_once_a_person_has_measured_it(front, play):
    """A stroke of 80 pixels is one of 20 mm where a person has measured 4 pixels per mm."""
    field = play.get_by_label("Width of the board on the glass")
    told = field.locator("xpath=..")
    assert "not those on the glass" in told.inner_text()
    box = play.locator(".board").bounding_box()
    field.fill(f"{box['width'] / 4:.3f}")
    field.press("Enter")
    assert "To scale" in told.inner_text()
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
    front.engine.reports.clear()
    play.mouse.move(x, y)
    play.mouse.down()
    play.mouse.move(x + 80, y, steps=4)
    play.mouse.up()
    wait_for(lambda: front.engine.reports and front.engine.reports[-1].kind == "up")
    places = [report.x_mm for report in front.engine.reports if report.kind != "up"]
    assert places[-1] - places[0] == pytest.approx(20.0, abs=0.01)
    field.fill("20")  # so fine that the window is too small for its millimetres
    field.press("Enter")
    assert "too small" in told.inner_text()
    field.fill("")
    field.press("Enter")
    assert "not those on the glass" in told.inner_text()
