"""The example page in a real browser: paired by the code, and touches as the pointer moves."""

import functools
import http.server
import threading
import time
from pathlib import Path

import pytest

from tests.chromium import chromium

CLIENT = Path(__file__).parents[2] / "clients" / "typescript"


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


@pytest.fixture
def address():
    server = http.server.ThreadingHTTPServer(
        ("127.0.0.1", 0), functools.partial(Quiet, directory=CLIENT)
    )
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_address[1]}/example/index.html"
    server.shutdown()
    server.server_close()


def hover_with_a_pen(page, x, y):
    """Move a pen above the glass, its barrel's button pressed: the browser calls that a "down"."""
    page.evaluate("pad.addEventListener('pointerdown', (e) => (window.pressed = e.buttons))")
    devtools = page.context.new_cdp_session(page)
    for kind, buttons in (("Pressed", 2), ("Moved", 2), ("Released", 0)):
        button = "none" if kind == "Moved" else "right"
        at = {"x": x, "y": y, "pointerType": "pen", "button": button, "buttons": buttons}
        devtools.send("Input.dispatchMouseEvent", {"type": f"mouse{kind}", "clickCount": 1, **at})
    assert page.evaluate("window.pressed") == 2


def test_ribs_under_the_pointer(service, address):
    # A person grants this in the browser's own prompt.
    with chromium(without=["LocalNetworkAccessChecks"]) as browser:
        page = browser.new_page()
        page.goto(f"{address}?url=ws://127.0.0.1:{service.port}/v1/session")
        page.get_by_role("button", name="Connect").click()
        page.get_by_text("not the code that the terminal shows").wait_for()
        page.get_by_label("Code").fill(service.access.code())
        page.get_by_role("button", name="Connect").click()
        page.get_by_text("slide over the ribs").wait_for()
        box = page.locator("#pad").bounding_box()
        hover_with_a_pen(page, box["x"] + 60, box["y"] + 40)
        page.mouse.move(box["x"] + 20, box["y"] + 40)  # hovers: no touch
        page.mouse.down()
        page.get_by_text("enter ribs").wait_for()
        page.mouse.move(box["x"] + 220, box["y"] + 40, steps=5)
        began_s = time.monotonic()
        page.mouse.up()
        page.get_by_role("button", name="Stop").click()
        page.get_by_text("stopped by session").wait_for()
    reports = service.engine.reports
    assert [reports[0].kind, reports[-1].kind] == ["down", "up"]
    assert {report.kind for report in reports[1:-1]} == {"move"}
    assert (reports[0].x_mm, reports[0].y_mm) == (5.0, 10.0)  # 20 and 40 px at 4 px/mm
    assert (reports[-1].x_mm, reports[-1].y_mm) == (55.0, 10.0)
    times = [report.t_s for report in reports]
    assert times == sorted(times)
    # The browser's clock by ours, which began hours before; a busy machine adds seconds.
    assert abs(reports[-1].t_s - began_s) < 30.0
