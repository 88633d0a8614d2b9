"""A driver that the engine's worker plays, in Chromium with the fakes of test_page_links.py.

The mock's clock is a twentieth of the page's: the 15 ms that the worker renders ahead are 300 ms of
the page, for which a busy machine may keep it waiting.
"""

import time

import numpy as np
import pytest

import haptix
from firmware_io.links.mock import MockDriver
from firmware_io.protocol import FaultCode
from haptix.feel.materials import Grating
from haptix.play import compile_touch
from tests.clients.driver_page import PACKAGE, served
from tests.clients.test_page_links import (  # noqa: F401  # fixtures
    ENDS_S,
    LONGEST_S,
    RATE_HZ,
    SLOW,
    bridge,
    browser,
    crash,
    is_at_0_v,
)
from tests.made_clients import ROOT
from tests.steady_clock import SteadyClock
from tests.waiting import wait_for

PACE = 0.05
FAKES = (ROOT / "tests" / "clients" / "fake_devices.js").read_text()
#: Devices of the worker: what happens to them is told by the page.
IN_WORKER = """
for (const kind of ["usb", "hid", "serial"]) navigator[kind].isChosen = true;
new BroadcastChannel("bus").onmessage = ({ data: [kind, what] }) => navigator[kind][what]();
"""
OPEN = """async (kind) => {
    const { Engine } = await import("/src/engine.js");
    const { PageDriver } = await import("/src/page-driver.js");
    const words = (error) => `${error.name}: ${error.message}`;
    window.engine ??= await Engine.load("/touch.hxp");
    try {
        window.driver = await PageDriver.open(kind, engine);
    } catch (error) {
        return words(error);
    }
    driver.addEventListener("failed", ({ detail }) => told.push(words(detail)));
    return driver.arm().then(() => "armed", words);
}"""
#: A finger that goes to and fro, until `up`.
STROKE = """() => {
    const began = performance.now();
    const timer = setInterval(() => {
        const s = (performance.now() - began) / 1000;
        engine.touch(1, 20 + 15 * Math.sin(5 * s), 9, { isDown: !window.up });
        if (window.up) clearInterval(timer);
    }, 8);
}"""


@pytest.fixture(scope="module")
def program(model):
    surface = haptix.FrictionSurface.build(model, {"normal_force_n": 0.5, "frequency_hz": 4000.0})
    with haptix.open_device(f"mock:sample_rate_hz={RATE_HZ}") as device:
        return compile_touch(surface, Grating(period_mm=2.0), device)


@pytest.fixture
def driver():
    return MockDriver(sample_rate_hz=RATE_HZ, pace="real", clock=SteadyClock(LONGEST_S, PACE))


@pytest.fixture
def page(browser, bridge, program):  # noqa: F811
    fakes = FAKES.replace("BRIDGE", bridge)
    worker = (PACKAGE / "src" / "worker.js").read_text()
    added = {
        "/src/worker.js": ("text/javascript", (fakes + IN_WORKER + worker).encode()),
        "/touch.hxp": ("application/octet-stream", program),
    }
    with served(added) as address:
        page = browser.new_page()
        page.add_init_script(fakes)
        page.goto(address)
        wait_for(lambda: page.title() == "ready")
        yield page
        page.close()


def strokes(page, driver, kind="usb"):
    page.click("#go", no_wait_after=True)
    assert page.evaluate(OPEN, kind) == "armed"
    page.evaluate(STROKE)
    wait_for(lambda: np.abs(driver.output_v[-400:]).max() > 30.0)


@pytest.mark.parametrize("kind", ["usb", *(pytest.param(k, marks=SLOW) for k in ("hid", "serial"))])
def test_a_slower_driver_is_played_at_its_own_pace(page, driver, kind):
    strokes(page, driver, kind)
    began, began_s = driver.output_v.size, time.perf_counter()
    wait_for(lambda: driver.output_v.size - began > 0.1 * RATE_HZ)  # 2 s of the page
    assert time.perf_counter() - began_s > 0.09 / PACE
    assert page.evaluate("told") == []
    assert (driver.faults, driver.status.underruns) == (0, 0)
    page.evaluate("window.up = true")
    lifted = driver.output_v.size
    wait_for(lambda: not driver.output_v[-200:].any())
    # What was ahead of it, a fade-out and some turns of the worker, which a busy machine keeps
    # waiting; and not the 1.9 s that the page's clock was ahead.
    assert np.flatnonzero(driver.output_v)[-1] - lifted < 0.5 * RATE_HZ
    page.evaluate("driver.stop()")
    wait_for(lambda: is_at_0_v(driver))


def test_a_busy_page_does_not_stop_the_drive(page, driver):
    strokes(page, driver)
    busy_ms = 1.25e3 * ENDS_S / PACE  # longer than the watchdog's time
    page.evaluate(f"const end = performance.now() + {busy_ms}; while (performance.now() < end);")
    wait_for(
        lambda: (
            np.abs(driver.output_v[-400:]).max() > 30.0  # the finger is felt again
            or page.evaluate("told.length")
        )
    )
    assert page.evaluate("[told, driver.isArmed]") == [[], True]
    assert (driver.faults, driver.status.underruns) == (0, 0)


@pytest.mark.parametrize(
    ("end", "fault"),
    [
        (lambda page: page.goto("about:blank"), None),
        (lambda page: page.evaluate("engine.close(), driver.close()"), FaultCode.STARVED),
        (crash, FaultCode.STARVED),
    ],
    ids=["left", "engine killed", "crashed"],
)
def test_a_page_that_ends_leaves_0_v(page, driver, end, fault):
    strokes(page, driver)
    end(page)
    ended = driver.output_v.size
    wait_for(lambda: is_at_0_v(driver))
    assert np.flatnonzero(driver.output_v)[-1] - ended < ENDS_S * RATE_HZ
    if fault is not None:
        assert driver.status.fault == fault


def test_what_ends_the_drive_is_told(page, driver):
    strokes(page, driver)
    page.evaluate(
        "Object.defineProperty(document, 'visibilityState', { value: 'hidden' });"
        "document.dispatchEvent(new Event('visibilitychange'))"
    )
    wait_for(lambda: is_at_0_v(driver))
    assert page.evaluate("told") == []
    assert page.evaluate("driver.arm().then(() => driver.isArmed)")
    page.evaluate("new BroadcastChannel('bus').postMessage(['usb', 'pullOut'])")
    page.wait_for_function("told.length === 1")
    assert "DriverError: the driver is gone" in page.evaluate("told[0]")
    assert not page.evaluate("driver.isArmed")
    assert "NotFoundError" in page.evaluate(f"navigator.usb.device = null, ({OPEN})('usb')")


def test_a_driver_that_is_opened_again_is_not_the_one_before(page, driver):
    strokes(page, driver)
    page.evaluate("window.before = window.driver")
    assert page.evaluate(OPEN, "hid") == "armed"
    assert page.evaluate("[before.isArmed, driver.isArmed]") == [False, True]
    page.evaluate("before.stop()")
    told = page.evaluate("before.arm().catch((error) => error.message)")
    assert "another driver was opened" in told
    assert page.evaluate("before.close().then(() => before.arm()).catch((e) => e.message)") == (
        "the driver is closed; open it again"
    )
    assert page.evaluate("driver.isArmed")
    wait_for(lambda: driver.is_armed and np.abs(driver.output_v[-400:]).max() > 30.0)
    page.evaluate("new BroadcastChannel('bus').postMessage(['hid', 'pullOut'])")
    page.wait_for_function("told.length > 0")
    page.wait_for_timeout(100)
    assert page.evaluate("[told.length, driver.isArmed]") == [1, False]


@pytest.mark.slow  # another test has the virtual driver, under Node
def test_strokes_are_played_on_the_virtual_driver(page):
    page.click("#go", no_wait_after=True)
    assert page.evaluate(OPEN, "virtual") == "armed"
    page.evaluate(STROKE)
    page.evaluate("window.driven = 0; window.blocks = 0")
    page.evaluate(
        "engine.addEventListener('block', ({ detail }) => {"
        " blocks += 1; driven = Math.max(driven, ...detail.driveV); })"
    )
    wait_for(lambda: page.evaluate("driven > 30 && blocks > 200"))
    assert page.evaluate("[told.length, driver.isArmed]") == [0, True]
    page.evaluate("driver.stop()")
    page.wait_for_function("!driver.isArmed")
    assert page.evaluate("told") == []
