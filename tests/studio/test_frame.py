"""The frame of the pages: pairing, STOP in its own process, undo, and what a browser may do."""

import re
import subprocess
from pathlib import Path

import httpx
import pytest

from tests.made_clients import make_clients, node_tools
from tests.service.test_sessions import Client
from tests.studio.conftest import ROOT, address, violations
from tests.waiting import wait_for

STATIC = ROOT / "haptix" / "studio" / "static"


def armed(page):
    page.locator('.output[data-state="armed"]').wait_for()


def test_from_a_bare_start_to_armed(front, page):
    page.goto(address(front))
    armed(page)
    told = [do for do, _, _ in front.engine.told]
    assert told.index("layout_set") < told.index("arm")
    assert not violations(page)
    # The address no longer shows the code, and the browser knows its token.
    assert "code" not in page.url
    page.reload()
    armed(page)


def test_an_engine_that_answers_late_gets_its_layout_nevertheless(front, page):
    front.engine.refuses["layout_set"] = "the engine did not answer"
    page.goto(address(front))
    wait_for(lambda: len(front.engine.when("layout_set")) > 1)
    assert not front.engine.when("arm")
    front.engine.refuses.clear()
    armed(page)


def test_a_wrong_code_and_then_the_right_one(front, page):
    shown = []
    front.access.on_show = shown.append
    page.goto(address(front).split("#")[0] + "#code=AAAAAAAA")
    page.get_by_text("this is not the code").wait_for()
    assert not violations(page)
    page.get_by_role("button", name="Show a code").click()
    page.get_by_text("The terminal shows a code now").wait_for()
    page.get_by_label("Code of the terminal").fill(shown[0].lower())
    page.keyboard.press("Enter")
    armed(page)
    assert any("403" in error for error in page.expected_errors)
    page.expected_errors.clear()


def test_stop_works_while_the_script_hangs(front, page):
    page.goto(address(front))
    armed(page)
    hung = []
    page.route("**/hang", lambda route: hung.append(route))  # is not answered before STOP is heard
    page.evaluate(
        """setTimeout(() => {
            const request = new XMLHttpRequest();
            request.open("GET", "/hang", false);
            request.send();
        }, 0)"""
    )
    while not hung:
        page.wait_for_timeout(10)
    page.mouse.click(1200, 30)  # to ask the page where STOP is would hang, too
    wait_for(lambda: front.engine.when("stop"))
    hung[0].fulfill(body="")
    page.get_by_text("Off: 0 V").wait_for()  # when the script is back


def test_escape_stops_nothing_on_the_page_and_in_the_frame(front, page):
    page.goto(address(front))
    armed(page)
    before = len(front.engine.when("stop"))
    page.keyboard.press("Escape")
    page.frame_locator("iframe.stop").get_by_role("button").focus()
    page.keyboard.press("Escape")
    page.keyboard.press("F8")  # sent after both
    page.get_by_text("Off: 0 V").wait_for()
    assert len(front.engine.when("stop")) == before + 1


def test_the_key_of_stop_is_shown_and_stops_from_anywhere(front, page):
    page.goto(address(front))
    armed(page)
    button = page.frame_locator("iframe.stop").get_by_role("button")
    assert "F8" in button.inner_text()
    page.keyboard.press("F8")
    page.get_by_text("Off: 0 V").wait_for()
    page.get_by_role("button", name="Arm").click()
    armed(page)
    before = len(front.engine.when("stop"))
    button.focus()  # keys go to the frame now
    page.keyboard.press("F8")
    page.get_by_text("Off: 0 V").wait_for()
    assert len(front.engine.when("stop")) == before + 1


def test_a_real_driver_waits_for_a_hand(front, page):
    device = front.hub.inventory.devices[0].model_copy(update={"is_real": True})
    front.hub.inventory = front.hub.inventory.model_copy(update={"devices": (device,)})
    page.goto(address(front))
    page.get_by_text("Off: 0 V").wait_for()
    assert not front.engine.when("arm")
    page.get_by_role("button", name="Arm").click()
    armed(page)
    for state in ("failed", "gone", "back"):
        told = {"event": "output", "state": state, "reason": "its cable was pulled."}
        front.hub.on_engine_event(told)  # the next ping lets the page hear of it
        page.get_by_text(f"Driver {'is ' * (state == 'back')}{state}: 0 V").wait_for()
        says = page.get_by_role("alert").filter(
            has_text="Press Arm" if state == "back" else "pulled"
        )
        says.wait_for()
    assert len(front.engine.when("arm")) == 1
    page.get_by_role("button", name="Arm").click()
    armed(page)


def test_the_header_says_what_is_so_while_a_job_plays_and_while_muted(front, page):
    page.goto(address(front))
    word = page.get_by_role("status").filter(has_text="Armed")
    word.wait_for()
    tell = front.hub.control  # the next ping lets the page hear of it
    tell.lend("calibration")
    page.get_by_text("A job has the device, and may play · calibration").wait_for()
    assert page.locator(".output button").is_hidden()  # arming would be refused
    tell.lend("")
    page.get_by_text("Off: 0 V").wait_for()
    page.get_by_role("button", name="Arm").click()
    word.wait_for()
    tell.set(person_muted=True)
    page.get_by_text("Armed, muted: 0 V").wait_for()


def test_a_second_page_observes_until_it_takes_over(front, page):
    page.goto(address(front))
    armed(page)
    second = page.context.new_page()
    second.goto(address(front).split("#")[0])
    second.get_by_role("button", name="Take over").click()
    armed(second)
    page.get_by_text("Another client holds the output").wait_for()


def test_what_is_kept_for_an_app_is_taken_by_a_person_s_click_alone(front, page):
    with Client(front) as app:
        app.holds()
    wait_for(lambda: front.hub.control._kept)  # its socket closed without a word
    page.goto(address(front))
    page.get_by_text("Another app has the output").wait_for()
    assert front.hub.control._kept
    page.get_by_role("button", name="Arm", exact=True).click()
    armed(page)
    assert not front.hub.control._kept


def test_a_service_that_goes_and_comes(front, page):
    page.goto(address(front))
    armed(page)
    for session in front.hub.sessions.values():
        session.close(1012, "a restart")
    page.locator('.output[data-state="lost"]').wait_for()
    armed(page)  # the driver is virtual


def test_localhost_leads_to_the_other_site(front):
    base = f"http://localhost:{front.port}"
    answer = httpx.get(f"{base}/", headers={"host": f"localhost:{front.port}"})
    assert answer.headers["location"] == f"http://127.0.0.1:{front.port}/"
    stop = httpx.get(f"{base}/stop")
    assert stop.status_code == 200 and "frame-ancestors" in stop.headers["content-security-policy"]


@pytest.mark.parametrize(
    "path",
    ["/studio/../pages.py", "/studio/%2e%2e/pages.py", "/client/../package.json", "/studio/"],
)
def test_nothing_beside_the_pages_is_given_out(front, path):
    assert httpx.get(f"http://127.0.0.1:{front.port}{path}").status_code == 404


def test_the_page_is_small(front):
    """All files together, as they go over the wire; a visit loads fewer."""
    sizes = {path.name: path.stat().st_size for path in STATIC.rglob("*") if path.is_file()}
    client = sum(path.stat().st_size for path in (ROOT / "clients/typescript/src").iterdir())
    assert sum(sizes.values()) + client < 500_000


@pytest.mark.slow
def test_types():
    make_clients()  # the pages' types are the messages'
    command = [node_tools() / ".bin" / "tsc", "-p", ROOT / "haptix" / "studio"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_what_is_not_ours_is_what_it_says():
    kept = STATIC / "vendor"
    made = node_tools() / "uplot" / "dist"
    assert (kept / "uPlot.min.js").read_bytes() == (made / "uPlot.iife.min.js").read_bytes()
    assert (kept / "uPlot.min.css").read_bytes() == (made / "uPlot.min.css").read_bytes()
    assert (kept / "uPlot.LICENSE").exists()


def test_no_page_names_another_place():
    """No network: nothing is loaded from elsewhere, whatever the policy would say."""
    for path in STATIC.rglob("*"):
        if path.is_file() and "vendor" not in Path(path).parts:
            found = re.findall(
                r"https?://(?!localhost|127\.0\.0\.1|www\.w3\.org/2000)\S+", path.read_text()
            )
            assert not found, path
