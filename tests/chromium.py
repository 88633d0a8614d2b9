"""Debian's Chromium, headless and with software drawing, as all tests of pages use it."""

import contextlib
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


@contextlib.contextmanager
def chromium(*arguments, without=()):
    """A browser, `without` some of its features.

    Playwright's loop ends with it, since asyncio bears no other beside it.
    """
    path = shutil.which("chromium")
    if path is None:
        pytest.skip("needs Debian's chromium: bash scripts/setup-devices.sh")
    off = ",".join((*BY_PLAYWRIGHT, *LIST_OF_ADDRESSES, *without))
    common = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
    common.append(f"--disable-features={off}")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=[*common, *arguments])
        yield browser
        browser.close()
