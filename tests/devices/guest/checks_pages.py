"""Checks of a page as the host: Chromium's own WebUSB, WebHID and WebSerial.

Without a display nobody can choose in the browser's list, so a policy grants the devices.
"""

import json
import os
import subprocess
import threading
import tty
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from firmware_io import MockDriver
from tests.devices.guest.descriptors import PRODUCT_ID, VENDOR_ID
from tests.devices.guest.plugged import PluggedBoard
from tests.devices.guest.ways import check, require

_FULL_SCALE_V = 250.0
#: Two ports of the guest that are wired to each other: the page's, and the board's.
_PORT, _BOARD_PORT = "/dev/ttyS2", "/dev/ttyS3"
_BAUD = 115_200
_LONG_MS = 300_000.0  # the guest has a tenth of a processor


@contextmanager
def _page():
    """A page that may open every driver, and is loaded."""
    from tests.chromium import chromium
    from tests.clients.driver_page import served

    with served() as address:
        numbers = {"vendor_id": VENDOR_ID, "product_id": PRODUCT_ID}
        origin = address.rstrip("/")
        granted = [{"devices": [numbers], "urls": [origin]}]
        policy = {
            "WebUsbAllowDevicesForUrls": granted,
            "WebHidAllowDevicesForUrls": granted,
            "SerialAllowAllPortsForUrls": [origin],
        }
        subprocess.run(["mount", "-t", "tmpfs", "tmpfs", "/etc/chromium"], check=True)
        rules = Path("/etc/chromium/policies/managed/haptix.json")
        rules.parent.mkdir(parents=True)
        rules.write_text(json.dumps(policy))
        try:
            with chromium() as browser:
                page = browser.new_page()
                page.set_default_timeout(_LONG_MS)
                page.goto(address, timeout=_LONG_MS)
                page.wait_for_function("document.title === 'ready'")
                yield page
        finally:
            subprocess.run(["umount", "/etc/chromium"], check=True)


def _opens(page, kind, **options):
    opened = page.evaluate(
        "([kind, options]) => opens(kind, { again: true, ...options })", [kind, options]
    )
    require(opened == "open", kind, opened)


def _plays(page, kind, played):
    """Whether what the page writes is what the board plays."""
    armed = page.evaluate("arms()")
    require(armed == "armed", kind, armed)
    before = len(played())
    sent = np.array(page.evaluate("plays(4000)"))
    written = page.evaluate("writing")
    require(written == "written", kind, written)
    page.wait_for_function("driver.status.samplesPlayed >= 4000")
    page.evaluate("driver.stop()")
    volts = played()[before : before + sent.size] * _FULL_SCALE_V / 32767
    code_v = _FULL_SCALE_V / 32767
    np.testing.assert_allclose(volts, sent, rtol=0, atol=0.501 * code_v)
    require(page.evaluate("told.length") == 0, kind, page.evaluate("told"))


@check()
def a_page_plays_over_usb_and_hid():
    """Every sample arrives; an unplug is told, and a replugged board plays again."""
    with PluggedBoard(sample_rate_hz=16_000.0) as board, _page() as page:
        for kind in ("hid", "usb"):
            _opens(page, kind)
            _plays(page, kind, board.played_codes)
            page.evaluate("driver.close()")
        _opens(page, "usb")
        require(page.evaluate("arms()") == "armed", "usb again")
        board.pull_out()
        page.wait_for_function("told.length === 1")
        told = page.evaluate("told[0]")
        require("driver" in told and not page.evaluate("driver.isArmed"), told)
        board.plug_in()
        page.evaluate("told.length = 0")
        page.wait_for_function("navigator.usb.getDevices().then((all) => all.length === 1)")
        _opens(page, "usb")
        _plays(page, "usb", board.played_codes)
        status, _ = board.about()
        require(status.faults == 0, status)
    return {"told": told}


_OPEN_ANY = """async (baudRate) => {
    const came = [];
    for (const port of await navigator.serial.getPorts()) {
        navigator.serial.getPorts = async () => [port];
        came.push(await opens("serial", { again: true, anyPort: true, baudRate }));
        if (came.at(-1) === "open") break;
    }
    return came;
}"""


@check()
def a_page_plays_over_a_serial_port():
    """Every sample arrives at the other end of a UART."""
    driver = MockDriver(sample_rate_hz=16_000.0)
    port = os.open(_BOARD_PORT, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(port)

    def serve():
        while True:
            driver.receive(os.read(port, 4096))
            while said := driver.transmit():
                os.write(port, said)

    threading.Thread(target=serve, daemon=True).start()
    # The browser lists the ports in an order of chance: that of the page is the only one left.
    hidden = [path for path in Path("/dev").glob("ttyS*") if str(path) != _PORT]
    for path in hidden:
        path.rename(path.with_name(f"hidden-{path.name}"))
    try:
        with _page() as page:
            opened = page.evaluate(_OPEN_ANY, _BAUD)
            require("open" in opened, opened)
            _plays(page, "serial", lambda: driver.played_codes)
            page.evaluate("driver.close()")
    finally:
        for path in hidden:
            path.with_name(f"hidden-{path.name}").rename(path)
    require(driver.faults == 0, driver.fault)
    return {}
