"""Debian's Chromium, headless and with software drawing, as all tests of pages use it."""

import contextlib
import json
import math
import shutil

import pytest
from playwright.sync_api import sync_playwright

#: The list beneath the address bar is a page itself, which Chromium loads for each window that a
#: test opens: half of the time of such a test. No test types an address.
LIST_OF_ADDRESSES = ("WebUIOmniboxPopup", "WebUIOmniboxFullPopup", "WebUIOmniboxAimPopup")
#: What Playwright switches off itself, and would be on again: of two lists Chromium takes the last.
BY_PLAYWRIGHT = (
    "AvoidUnnecessaryBeforeUnloadCheckSync",
    "DestroyProfileOnBrowserClose",
    "HttpsUpgrades",
    "HttpsFirstBalancedModeAutoEnable",
    "MediaRouter",
    "PaintHolding",
    "ThirdPartyStoragePartitioning",
    "AvoidCorsURLLoaderRestartOnRedirect",
    "OptimizationHints",
    "NetworkTimeServiceQuerying",
    "PreconnectToSearch",
)


def _how(without=()):
    """Where Chromium is, and its arguments."""
    path = shutil.which("chromium")
    if path is None:
        pytest.skip("needs Debian's chromium: bash scripts/setup-devices.sh")
    off = ",".join((*BY_PLAYWRIGHT, *LIST_OF_ADDRESSES, *without))
    common = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
    return path, [*common, f"--disable-features={off}"]


@contextlib.contextmanager
def chromium(*arguments, without=()):
    """A browser, `without` some of its features.

    Playwright's loop ends with it, since asyncio bears no other beside it.
    """
    path, common = _how(without)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=[*common, *arguments])
        yield browser
        browser.close()


@contextlib.contextmanager
def zoomed_page(folder, zoom):
    """A page of a browser that keeps all in a folder, and whose person has zoomed all pages."""
    path, common = _how()
    file = folder / "Default" / "Preferences"
    preferences = json.loads(file.read_text()) if file.exists() else {}
    level = {"x": math.log(zoom) / math.log(1.2)}
    preferences.setdefault("partition", {})["default_zoom_level"] = level
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(preferences))
    with sync_playwright() as playwright:
        context = playwright.chromium.launch_persistent_context(
            folder, executable_path=path, args=common, no_viewport=True
        )
        assert context.pages[0].evaluate("devicePixelRatio") == pytest.approx(zoom)
        yield context.pages[0]
        context.close()
