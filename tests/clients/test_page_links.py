"""A page's links to a driver, in Chromium: WebUSB, WebHID, WebSerial with a mock behind each.

The browser's objects are fakes (fake_devices.js); `tests/devices` has the real ones.
"""

import contextlib
import threading
import time

import numpy as np
import pytest
from playwright.sync_api import Error
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import serve

from firmware_io.links.mock import MockDriver
from firmware_io.protocol import DeviceState, FaultCode
from tests.chromium import chromium
from tests.clients.driver_page import served
from tests.made_clients import ROOT
from tests.steady_clock import SteadyClock
from tests.waiting import wait_for

KINDS = ["usb", "hid", "serial"]
RATE_HZ = 16_000  # what all of them carry
#: The mock's clock beside this machine's, and how much of this machine's time counts at a look: a
#: page that waits for a processor leaves nothing dry, and where all waits the clock does too.
PACE, LONGEST_S = 0.2, 0.004
CODE_V = 250.0 / 32767
ENDS_S = 0.105  #: the watchdog that a page asks for, and a ramp


@pytest.fixture(scope="module")
def address():
    with served() as address:
        yield address


@pytest.fixture
def driver():
    return MockDriver(sample_rate_hz=RATE_HZ, pace="real", clock=SteadyClock(LONGEST_S, PACE))


@pytest.fixture
def bridge(driver):
    """The address of a socket whose other end is the mock: its reports below /hid, else bytes."""

    def carry(socket):
        is_hid = socket.request.path == "/hid"
        take = driver.receive_report if is_hid else driver.receive
        give = driver.transmit_report if is_hid else driver.transmit
        with contextlib.suppress(ConnectionClosed):
            while True:
                with contextlib.suppress(TimeoutError):
                    take(socket.recv(timeout=0.002))
                while said := give():
                    socket.send(said)
        # A closed link is no news to a board on a bus that stays: its watchdog ends the output.

    with serve(carry, "127.0.0.1", 0) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"ws://127.0.0.1:{server.socket.getsockname()[1]}"
        server.shutdown()


@pytest.fixture(scope="module")
def browser():
    with chromium() as browser:
        yield browser


@pytest.fixture
def page(browser, address, bridge):
    page = browser.new_page()
    fakes = (ROOT / "tests" / "clients" / "fake_devices.js").read_text()
    page.add_init_script(fakes.replace("BRIDGE", bridge))
    page.goto(address)
    wait_for(lambda: page.title() == "ready")
    yield page
    page.close()


def chosen(page, kind):
    """What came of a click that chooses a device, opens and arms it."""
    page.evaluate("(kind) => { go.name = kind; window.done = null; }", kind)
    page.click("#go")
    page.wait_for_function("window.done")
    return page.evaluate("done")


def is_at_0_v(driver):
    return not driver.is_armed and driver.output_v[-1] == 0.0


def plays(page, driver):
    """Whether what is written arrives, sample for sample."""
    begins = driver.samples_played
    sent = np.array(page.evaluate("plays(4000)"))
    assert page.evaluate("writing") == "written"
    wait_for(lambda: driver.samples_played - begins >= sent.size)
    page.evaluate("driver.stop()")
    played = driver.played_v[begins : begins + sent.size]
    np.testing.assert_allclose(played, sent, rtol=0, atol=0.501 * CODE_V)
    wait_for(lambda: is_at_0_v(driver))


@pytest.mark.slow  # the next test plays as well
@pytest.mark.parametrize("kind", KINDS)
def test_what_a_page_plays_arrives_and_ends_at_0_v(page, driver, kind):
    assert chosen(page, kind) == "armed"
    plays(page, driver)
    assert driver.faults == 0
    assert page.evaluate("driver.close().then(() => told)") == []


@pytest.mark.parametrize("kind", KINDS)
def test_a_driver_that_is_pulled_out_is_told_and_opened_again_by_a_click(page, driver, kind):
    assert "NotFoundError" in page.evaluate("(kind) => opens(kind, { again: true })", kind)
    assert chosen(page, kind) == "armed"
    page.evaluate("void plays(200_000)")
    wait_for(lambda: np.abs(driver.output_v[-100:]).max() > 50.0)
    page.evaluate("(kind) => navigator[kind].pullOut()", kind)
    page.wait_for_function("told.length === 1")
    assert "driver" in page.evaluate("told[0]")
    assert "Error" in page.evaluate("writing")
    assert not page.evaluate("driver.isArmed")
    wait_for(lambda: is_at_0_v(driver))
    assert "NotFoundError" in page.evaluate("(kind) => opens(kind, { again: true })", kind)
    page.evaluate("(kind) => navigator[kind].plugIn()", kind)
    assert page.evaluate("(kind) => opens(kind, { again: true })", kind) == "open"
    assert page.evaluate("driver.close().then(() => 1)") == 1
    assert chosen(page, kind) == "armed"
    plays(page, driver)


SLOW = pytest.mark.slow  # the driver's part is that of USB


@pytest.mark.parametrize("kind", ["usb", *(pytest.param(k, marks=SLOW) for k in ("hid", "serial"))])
def test_a_transfer_that_never_ends_is_told_and_closed(page, driver, kind):
    assert chosen(page, kind) == "armed"
    page.evaluate("void plays(200_000)")
    wait_for(lambda: np.abs(driver.output_v[-100:]).max() > 50.0)
    page.evaluate("(kind) => { navigator[kind].hangs = true }", kind)
    page.wait_for_function("told.length === 1")
    assert "check its cable" in page.evaluate("told[0]")
    assert not page.evaluate("driver.isArmed")
    assert "DriverError" in page.evaluate("writing")
    wait_for(lambda: is_at_0_v(driver))
    wait_for(lambda: driver.status.state == DeviceState.IDLE)  # its host is gone
    assert page.evaluate("driver.close().then(() => told.length)") == 1


def hide(page):
    page.evaluate(
        """() => {
            Object.defineProperty(document, "visibilityState", { value: "hidden" });
            document.dispatchEvent(new Event("visibilitychange"));
        }"""
    )


def busy(page):
    page.evaluate("const end = performance.now() + 2000; while (performance.now() < end);")


def crash(page):
    with pytest.raises(Error):
        page.goto("chrome://crash")


@pytest.mark.parametrize(
    ("end", "fault"),
    [
        (hide, FaultCode.NONE),
        (lambda page: page.evaluate("worker.terminate()"), FaultCode.NONE),
        # By its STOP, or where a busy machine does not let it send one, by the watchdog.
        (lambda page: page.goto("about:blank"), None),
        (lambda page: page.close(), None),
        (crash, FaultCode.STARVED),
        (busy, FaultCode.STARVED),
    ],
    ids=["hidden", "engine killed", "left", "closed", "crashed", "busy"],
)
def test_a_page_that_ends_leaves_0_v_within_the_watchdog_s_time(page, driver, end, fault):
    """In the driver's own time, which its watchdog counts."""
    assert chosen(page, "usb") == "armed"
    page.evaluate("strokes()")
    wait_for(lambda: np.abs(driver.output_v[-100:]).max() > 50.0)
    begins = driver.output_v.size
    end(page)
    ended = driver.output_v.size
    wait_for(lambda: is_at_0_v(driver))
    last = np.flatnonzero(driver.output_v)[-1]
    assert last > begins
    assert last - ended < ENDS_S * RATE_HZ
    if end is busy:
        assert last - begins < (ended - begins) / 2
    if fault is not None:
        assert driver.status.fault == fault


def test_blocks_that_come_too_fast_are_told_and_do_not_queue_up(page, driver):
    assert chosen(page, "usb") == "armed"
    page.evaluate("strokes(8)")
    wait_for(lambda: np.abs(driver.output_v[-100:]).max() > 50.0)
    page.wait_for_function("told.length === 1")
    assert "slower than the blocks come" in page.evaluate("told[0]")
    told = driver.output_v.size
    wait_for(lambda: is_at_0_v(driver))
    assert np.flatnonzero(driver.output_v)[-1] - told < ENDS_S * RATE_HZ
    assert driver.faults == 0


def test_a_page_opens_a_known_driver_alone_but_does_not_arm_it(page, driver, address):
    # Whatever Playwright evaluates counts as a click: nothing is asked until the page is done.
    with page.expect_console_message(lambda message: message.text == "done"):
        page.goto(f"{address}?alone")
    opened, armed = page.evaluate("alone")
    assert opened == "open"
    assert "a driver is armed by a person" in armed
    assert not driver.is_armed


def test_what_cannot_be_opened_tells_why(page):
    page.evaluate("navigator.usb.hasVendors = false")
    assert "try hid" in chosen(page, "usb")
    page.evaluate("navigator.usb.hasVendors = true; navigator.usb.plugIn()")
    assert "no navigator.bluetooth2" in page.evaluate("opens('bluetooth2')")
    page.click("body")
    page.evaluate("navigator.usb.isBusy = true")
    words = page.evaluate("opens('usb')")
    assert "Unable to claim interface" in words and "haptix doctor" in words
    page.evaluate("navigator.hid.isCancelled = true")
    assert "NotFoundError" in page.evaluate("opens('hid')")
    page.evaluate("navigator.serial.isCancelled = true")
    assert "NotFoundError" in page.evaluate("opens('serial')")


def test_a_board_that_wakes_late_is_asked_again(page, driver, monkeypatch):
    """One that was just plugged in is at 0 V for a second, and hears nothing."""
    awake_s = time.monotonic() + 0.8
    receive = driver.receive
    monkeypatch.setattr(
        driver, "receive", lambda data: time.monotonic() > awake_s and receive(data)
    )
    assert chosen(page, "usb") == "armed"
