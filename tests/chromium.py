"""Debian's Chromium, headless and with software drawing, as all tests of pages use it."""

import contextlib
import shutil

import pytest
from playwright.sync_api import sync_playwright


@contextlib.contextmanager
def chromium(*arguments):
    """A browser; Playwright's loop ends with it, since asyncio bears no other beside it."""
    path = shutil.which("chromium")
    if path is None:
        pytest.skip("needs Debian's chromium: bash scripts/setup-devices.sh")
    common = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=[*common, *arguments])
        yield browser
        browser.close()
