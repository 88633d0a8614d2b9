"""A film of the whole studio: no page error, whatever is late.

`HAPTIX_FILMS=50 pytest -m slow tests/studio/test_film.py` plays it that often, beside programs that
compute; without it the other tests are beside it.
"""

import contextlib
import os
import subprocess
import sys

import pytest

from tests.studio.conftest import a_page
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
