"""`haptix studio` as a person starts it: from nothing to a felt texture, and what goes wrong."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from playwright.sync_api import TimeoutError

from haptix.service.protocol.batches import COLUMNS, read_frame
from tests.service.test_processes import Running
from tests.studio.conftest import a_page, keep, violations
from tests.waiting import PATIENCE_S, wait_for

pytestmark = pytest.mark.slow  # starts the whole service; the pages alone are tested before a front


def slide(page, seconds=1.5):
    """Slide over the first region, as fast as this machine sends."""
    box = page.locator(".board").bounding_box()
    page.mouse.move(box["x"] + 0.1 * box["width"], box["y"] + 0.25 * box["height"])
    page.mouse.down()
    began_s = time.monotonic()
    while (t_s := time.monotonic() - began_s) < seconds:
        x = 0.1 + 0.3 * (0.5 - 0.5 * np.cos(4 * t_s))
        page.mouse.move(box["x"] + x * box["width"], box["y"] + 0.25 * box["height"])
    felt = page.locator('[data-name="felt"] dd').inner_text()  # a finger at rest feels none
    page.mouse.up()
    return felt


def armed(page):
    page.locator('.output[data-state="armed"]').wait_for()


def armed_again(page):
    """Wait until it is armed; arm it where it is off, as when this machine stood for seconds."""

    def is_armed():
        if page.locator('.output[data-state="armed"]').count():
            return True
        button = page.get_by_role("button", name="Arm", exact=True)
        with contextlib.suppress(TimeoutError):  # it is armed meanwhile
            if button.is_visible():
                button.click(timeout=1000)
        page.wait_for_timeout(500)
        return False

    wait_for(is_armed)


def slide_until_felt(page):
    """The virtual finger makes its tables first, and a busy machine takes long."""

    def felt():
        armed_again(page)
        return slide(page) != "–"

    wait_for(felt)


def slide_until_live(page, service):
    """A busy machine may send the first strokes too late to be felt."""
    before = len(service.driver.output_v)

    def live():
        armed_again(page)
        slide(page)
        return np.any(service.driver.output_v[before:])

    wait_for(live)


def has_stripes(page):
    """Look for a minute; the service gives up what takes it long, and a new page asks again."""
    try:
        page.wait_for_function(
            """() => {
                const canvas = document.querySelector(".board canvas");
                if (!canvas) return false;
                const { data } = canvas.getContext("2d").getImageData(
                    canvas.width * 0.1, canvas.height * 0.3, canvas.width * 0.2, 1);
                const greens = [...data].filter((_, at) => at % 4 === 1);
                return Math.max(...greens) - Math.min(...greens) > 150;
            }""",
            timeout=60_000,
        )
    except TimeoutError:
        page.reload()
        return False
    return True


@contextlib.contextmanager
def live(folder, browser):
    """A service whose driver counts as real, and its page once a hand has armed it."""
    with pytest.MonkeyPatch.context() as named:
        named.setattr("firmware_io.links.mock.MOCK_NAME", "board")
        service = Running(folder / "service")
    try:
        with a_page(browser) as page:
            code = re.search(r"code for a page: (\w+)", "".join(service.lines))[1]
            page.goto(f"http://127.0.0.1:{service.port}/#code={code}")
            page.locator('.output[data-state="off"]').wait_for()
            page.get_by_role("button", name="Arm").click()
            armed(page)
            yield service, page
    finally:
        service.close()


def test_from_a_bare_start_to_a_felt_texture(studio, browser):
    with a_page(browser) as page:
        frames = []
        page.on(
            "websocket", lambda socket: socket.on("framereceived", lambda data: frames.append(data))
        )
        page.goto(studio)
        armed(page)
        slide_until_felt(page)
        keep(page, "play")

        def felt_rows():
            """What was felt in all strokes; those that were felt from the first to the last too."""
            armed_again(page)
            slide(page)
            rows = [read_frame(data) for data in frames if isinstance(data, bytes)]
            felt = np.concatenate([one.rows[:, 0] for one in rows if one.stream == "felt"])
            return rows, felt[~np.isnan(felt)]

        rows, known = wait_for(lambda: found if len((found := felt_rows())[1]) > 200 else None)
        friction = np.concatenate([one.rows for one in rows if one.stream == "friction"])
        low, high = (friction[:, COLUMNS["friction"].index(name)] for name in ("low", "high"))
        # The ribs ask for all that can be had.
        assert np.nanmin(low) * 0.98 < known.min() < known.max() < np.nanmax(high) * 1.02
        assert known.max() - known.min() > 0.5 * np.nanmedian(high - low)
        shown = float(page.locator('[data-name="wanted"] dd').inner_text())
        assert np.nanmin(low) - 0.001 <= shown <= np.nanmax(high) + 0.001
        # The picture is the service's own, not the draft: stripes from the lowest to the highest.
        wait_for(lambda: has_stripes(page))
        page.get_by_role("link", name="Screens").click()
        page.get_by_text("3m-sct3250 (preset)").wait_for()
        page.get_by_text("roughness: a placeholder").wait_for()
        keep(page, "screens")
        assert not violations(page)


def test_an_engine_that_dies_is_seen_and_comes_again(tmp_path, browser):
    with live(tmp_path, browser) as (service, page):
        slide_until_live(page, service)
        subprocess.run(["kill", "-9", str(service.engine)], check=True)
        page.locator('.output:not([data-state="armed"])').wait_for()
        page.locator(".trouble", has_text="Look after its cable").wait_for()
        wait_for(lambda: not service.is_live())
        keep(page, "error-engine")
        armed_again(page)  # a new engine opens the driver first, and says so
        slide_until_live(page, service)  # the service has told it the layout


def test_a_driver_that_is_unplugged_is_named(tmp_path, browser):
    with live(tmp_path, browser) as (service, page):
        service.server.stop()
        slide(page, 1.0)
        page.locator('.output:not([data-state="armed"])').wait_for()
        page.locator(".trouble", has_text="Look after its cable").wait_for()
        assert not violations(page)
        keep(page, "error-unplugged")


def stopped_while_its_script_hangs(service, page):
    """Press STOP on a page whose script hangs; return the reason that the page gives."""
    slide_until_live(page, service)
    page.evaluate(
        "setTimeout(() => { const end = Date.now() + 5000; while (Date.now() < end); }, 20)"
    )
    time.sleep(0.1)
    page.mouse.click(1200, 30)
    # Its script hangs for five seconds: its silence ends the voltage, and then it says so.
    page.locator('.output[data-state="off"]').wait_for()
    wait_for(lambda: not service.is_live())
    return page.locator(".output .word").get_attribute("title")


def test_stop_while_the_script_hangs_ends_the_volts(tmp_path, browser):
    with live(tmp_path, browser) as (service, page):
        # On a busy machine the engine may be silent for too long just then, and is replaced.
        for _ in range(5):
            reason = stopped_while_its_script_hangs(service, page)
            if reason != "the engine is there again":
                break
        assert reason == "stopped by the button"


def test_the_service_that_ends_is_said_and_a_new_one_is_found(tmp_path, browser):
    environment = {"HAPTIX_SERVICE": str(tmp_path)}

    def start(port):
        command = [
            sys.executable,
            "-m",
            "haptix.tasks.cli",
            "studio",
            "--port",
            str(port),
            "--no-open",
        ]
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, text=True, env=os.environ | environment
        )
        return process, process.stdout.readline()

    process, line = start(0)
    address = re.search(r"http://\S+", line)[0]
    port = int(re.search(r":(\d+)/", address)[1])
    try:
        with a_page(browser) as page:
            page.goto(address)
            armed(page)
            process.send_signal(signal.SIGKILL)
            process.wait()
            page.locator('.output[data-state="lost"]').wait_for()
            page.locator(".trouble", has_text="start it again in its terminal").wait_for()
            keep(page, "error-lost")
            process.stdout.close()
            process, _ = start(port)
            armed(page)  # by the token of this browser; no code is asked for
            assert page.locator(".trouble").is_hidden()
            page.expected_errors.clear()  # the attempts between
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=PATIENCE_S)
    assert json.loads((tmp_path / "tokens.json").read_text())
