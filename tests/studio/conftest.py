"""A studio in Chromium: before a front that writes down what it is told, or all of haptix."""

import contextlib
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.chromium import chromium
from tests.made_clients import node_tools
from tests.service.service_under_test import Service
from tests.waiting import PATIENCE_S

ROOT = Path(__file__).parents[2]
SCREENSHOTS = os.environ.get("HAPTIX_SCREENSHOTS")
"""Folder that screenshots are kept in, for docs/studio.md; nothing is kept without it."""


@pytest.fixture(scope="package")
def browser():
    """Chromium, one for all pages.

    What checks a page comes with Node's packages. Without them all tests of pages are skipped here:
    one that skips itself in its middle leaves its page to the next test half changed.
    """
    node_tools()
    with chromium() as browser:
        yield browser


@pytest.fixture
def front(tmp_path):
    """The front alone, whose engine writes down what it is told; starts in no time."""
    with a_front(tmp_path) as service:
        yield service


@contextlib.contextmanager
def a_front(folder, documents=None):
    """Serve the pages with an engine that writes down, and a virtual driver."""
    service = Service(folder, documents)
    device = service.hub.inventory.devices[0]
    virtual = device.model_copy(update={"address": "mock:", "name": "mock", "is_real": False})
    service.hub.inventory = service.hub.inventory.model_copy(update={"devices": (virtual,)})
    yield service
    service.close()


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    """Address, with a code that pairs one browser, of `haptix studio` with a mock driver."""
    folder = tmp_path_factory.mktemp("service")
    with a_studio(os.environ | {"HAPTIX_SERVICE": str(folder)}) as address:
        yield address


@contextlib.contextmanager
def a_studio(environment):
    """Run `haptix studio` in an environment; its address, with a code."""
    command = [sys.executable, "-m", "haptix.tasks.cli", "studio", "--port", "0", "--no-open"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        found = re.search(r"http://127.0.0.1:\d+/#code=\w{8}", process.stdout.readline())
        assert found
        try:
            yield found[0]
        finally:  # what failed must not wait for the service for ever
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=PATIENCE_S)


@pytest.fixture
def page(browser):
    """A page of 1280 x 800; what its scripts complain of fails the test."""
    with a_page(browser) as page:
        yield page


@contextlib.contextmanager
def a_page(browser):
    """Open a page, and fail at its end if its scripts complained of something."""
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    context.set_default_timeout(1e3 * PATIENCE_S)
    page = context.new_page()
    errors = page.expected_errors = []  # a test that provokes some clears them

    def hear(said):
        # The front alone has nobody who draws pictures and knows of volts.
        url = said.location.get("url", "")
        if said.type == "error" and not url.endswith(("/v1/pictures", "/v1/drive")):
            errors.append(f"{said.text} {url}")

    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", hear)
    yield page
    context.close()
    assert not errors


def address(front, path=""):
    """Address of a page of the front, with a code."""
    return f"http://127.0.0.1:{front.port}/#code={front.access.code()}"


def violations(page):
    """What axe finds wrong with a page, in short."""
    axe = node_tools() / "axe-core" / "axe.min.js"
    page.evaluate(axe.read_text() + "; 0")  # the policy refuses a script that is added
    found = page.evaluate("async () => (await axe.run(document)).violations")
    return [(one["id"], one["nodes"][0]["html"][:120]) for one in found]


def keep(page, name):
    """Keep a screenshot if that was asked for."""
    if SCREENSHOTS:
        page.screenshot(path=Path(SCREENSHOTS) / f"{name}.png")
