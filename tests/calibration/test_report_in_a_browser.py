"""The report in a real browser: it loads, shows its drawings, opens a trace, and prints."""

import shutil

import numpy as np
import pytest

from calibration import Parameters, fit_strokes, short_protocol, verify, write_report

sync_playwright = pytest.importorskip("playwright.sync_api").sync_playwright
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium: setup-devices.sh")


@pytest.fixture
def page_file(tmp_path, predictor, reduced_of, finger, screen, recorded):
    start = Parameters.of(finger, screen)
    plan = short_protocol(predictor, start, max_voltage_v=150.0)
    strokes = reduced_of(predictor, plan, start, np.random.default_rng(1))
    fit = fit_strokes(strokes, predictor, start, bootstraps=0)
    found = verify(fit, strokes, predictor)
    recordings = [recorded(one, rate_hz=2000.0) for one in plan.strokes[:3]]
    path = tmp_path / "report.html"
    write_report(path, screen, fit, strokes, found, predictor, recordings=recordings)
    return path


def test_a_browser_shows_opens_and_prints_it(page_file, tmp_path):
    with sync_playwright() as p:
        browser = p.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1000, "height": 900}, offline=True)
        errors = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("request", lambda one: errors.append(one.url) if "://" in one.url[5:] else None)
        page.goto(page_file.as_uri())
        assert page.title() == "Calibration of panel 7"
        sizes = page.eval_on_selector_all("img", "all => all.map(one => one.naturalWidth)")
        assert len(sizes) == 3
        assert min(sizes) > 500
        # Nothing is wider than the page.
        assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
        is_open = page.eval_on_selector_all("details", "all => all.map(one => one.open)")
        closed = page.locator("details").nth(is_open.index(False))
        closed.locator("summary").click()
        assert closed.locator("svg").bounding_box()["height"] > 100
        page.screenshot(path=str(tmp_path / "page.png"), full_page=True)
        page.emulate_media(media="print")
        assert len(page.pdf(format="A4")) > 10_000
        browser.close()
    assert [one for one in errors if not one.startswith("file:")] == []
