"""Films of the whole studio: no page error, whatever is late, and a designer's list in one go.

`HAPTIX_FILMS=50 pytest -m slow tests/studio/test_film.py` plays the first that often, beside
programs that compute; without it the other tests are beside it. `HAPTIX_SCREENSHOTS=FOLDER` keeps
the pictures of the second.
"""

import contextlib
import json
import os
import subprocess
import sys

import pytest
from PIL import Image
from skimage import data

from tests.studio.conftest import SCREENSHOTS, a_page, a_studio, keep
from tests.studio.test_whole_studio import armed_again
from tests.waiting import wait_for

pytestmark = pytest.mark.slow

FILMS = int(os.environ.get("HAPTIX_FILMS", "1"))
PROGRAMS = 2 if "HAPTIX_FILMS" in os.environ else 0  # that compute: the cores of a small machine
COMPUTES = "while True: sum(range(10**6))"


@pytest.fixture(scope="module")
def busy():
    """Programs that compute."""
    with contextlib.ExitStack() as programs:
        computing = [
            programs.enter_context(subprocess.Popen([sys.executable, "-c", COMPUTES]))
            for _ in range(PROGRAMS)
        ]
        yield
        for program in computing:
            program.kill()


@pytest.fixture(scope="module")
def visited(studio, browser, busy):
    """One page for all films: the code of the address is good for one browser."""
    with a_page(browser) as page:
        page.goto(studio)
        yield page


def two_fingers(page, moves=40):
    """Two fingers slide to and fro over the board; one lifts before the other."""
    box = page.locator(".board").bounding_box()
    hands = page.context.new_cdp_session(page)

    def send(kind, *fingers):
        points = [
            {
                "id": finger,
                "x": box["x"] + box["width"] * (0.15 + 0.4 * finger + 0.01 * (number % 25)),
                "y": box["y"] + box["height"] * (0.3 + 0.3 * finger),
            }
            for finger in fingers
        ]
        hands.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    for number in range(moves):
        send("touchMove" if number else "touchStart", 0, 1)
    send("touchEnd", 1)
    send("touchMove", 0)
    send("touchEnd", 0)
    hands.detach()


@pytest.mark.parametrize("film", range(FILMS))
def test_a_film_has_no_page_error(visited, film):
    page = visited
    page.get_by_role("link", name="Make").click()
    page.locator(".thumb").first.wait_for()
    page.locator("summary", has_text="Layouts").click()
    page.get_by_text("New layout", exact=True).click()
    wait_for(lambda: not page.locator("button.region").count())
    for number in range(3):
        page.locator(".thumb").nth((film + 5 * number) % 12).click()
        page.locator("button.region").nth(number).wait_for()
    region = page.locator("button.region").first
    region.focus()
    for key in ("ArrowRight", "ArrowDown", "Shift+ArrowRight", "Control+z"):
        page.keyboard.press(key)
    page.get_by_text("draft saved").wait_for()
    page.get_by_role("link", name="Play").click()
    armed_again(page)
    two_fingers(page)
    page.reload()
    armed_again(page)
    two_fingers(page)  # the first touch after a reload too
    page.get_by_role("link", name="Make").click()
    wait_for(lambda: page.locator("button.region").count() == 3)
    assert page.expected_errors == []


def test_a_designer_works_through_the_list(tmp_path, browser):
    """By mouse and keyboard, at the whole studio with a mock driver; the kept file is the proof."""
    folder = tmp_path / "service"
    files = {name: tmp_path / f"{name}.png" for name in ("brick", "gravel", "app")}
    Image.fromarray(data.brick()[::4, ::4]).save(files["brick"])
    Image.fromarray(data.gravel()[::4, ::4]).save(files["gravel"])
    Image.fromarray(data.astronaut()).save(files["app"])
    with a_studio(os.environ | {"HAPTIX_SERVICE": str(folder)}) as address, a_page(browser) as page:

        def shot(name):
            page.wait_for_timeout(500 if SCREENSHOTS else 0)  # for the pictures
            keep(page, f"designer-{name}")

        def region(name):
            return page.locator(f'button.region[aria-label^="{name}:"]')

        def edit(command):
            page.locator("summary", has_text="Edit").click()
            page.locator(".menu button", has_text=command).click()

        page.goto(address)
        armed_again(page)
        page.get_by_role("link", name="Make").click()
        page.locator(".thumb").first.wait_for()
        page.get_by_role("button", name="End the guide").click()
        page.locator("summary", has_text="Layouts").click()
        page.get_by_text("New layout", exact=True).click()
        wait_for(lambda: not page.locator("button.region").count())
        for name in ("brick", "gravel"):
            page.get_by_label("Add a file").set_input_files(files[name])
            page.get_by_role("heading", name=f"Parameters of {name}").wait_for()
        page.get_by_label("How the picture is felt").select_option("as a relief")
        page.locator(".panel legend", has_text="Relief").wait_for()
        shot("relief")
        region("gravel").press("F2")
        page.keyboard.type("path")
        page.keyboard.press("Enter")
        region("path").wait_for()
        page.keyboard.press("Control+d")
        region("path 2").wait_for()
        page.keyboard.press("Control+a")
        edit("Align top")
        edit("Same gaps from left to right")
        page.keyboard.press("Escape")
        region("brick").click(position={"x": 10, "y": 60})
        region("path 2").click(modifiers=["Shift"])
        page.keyboard.press("Control+g")
        shot("group")
        page.locator(".board").hover()
        page.keyboard.down("Control")
        page.mouse.wheel(0, -300)
        page.keyboard.up("Control")
        shown = page.locator(".zoom button").nth(1)
        wait_for(lambda: shown.inner_text() != "100 %")
        shot("zoom")
        shown.click()
        wait_for(lambda: shown.inner_text() == "100 %")
        page.get_by_label("Show a picture beneath").set_input_files(files["app"])
        page.get_by_role("button", name="Grey").click()
        shot("beneath")
        page.keyboard.press("Escape")
        region("brick").click(position={"x": 10, "y": 60})  # and so its group
        page.keyboard.press("Delete")
        wait_for(lambda: page.locator("button.region").count() == 1)
        shot("deleted")
        page.keyboard.press("Control+z")
        wait_for(lambda: page.locator("button.region").count() == 3)
        name = page.get_by_label("Name of the layout")
        name.fill("desk")
        name.press("Enter")
        page.keyboard.press("Control+s")
        page.get_by_text("kept as desk").wait_for()
        armed_again(page)
        page.keyboard.press("F8")
        page.get_by_text("Off: 0 V").wait_for()
        shot("stop")
    (path,) = (folder / "layouts" / "desk").glob("*.json")
    regions = {one["name"]: one for one in json.loads(path.read_text())["regions"]}
    assert regions.keys() == {"brick", "path", "path 2"}
    materials = {name: one["material"] for name, one in regions.items()}
    assert materials["brick"]["kind"] == "photograph"
    assert materials["path"]["kind"] == "relief"
    assert materials["path 2"] == materials["path"]
    assert materials["brick"]["file"] != materials["path"]["heights"]
    assert len({one["y_mm"] for one in regions.values()}) == 1
    groups = {name: one.get("group") for name, one in regions.items()}
    assert groups == {"brick": "Group", "path": None, "path 2": "Group"}
