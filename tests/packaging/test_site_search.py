"""What a newcomer types into the search of the built site leads to the page that answers it."""

import base64
import functools
import http.server
import io
import os
import re
import subprocess
import sys
import threading
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

import haptix
from tests.chromium import chromium

ROOT = Path(haptix.__file__).parents[1]
SEARCHES = {
    "unity": "howto/unity.html",
    "how do I calibrate": "howto/calibrate.html",
    "Texture.from_image": "reference/haptix.feel.html#haptix.feel.Texture.from_image",
    "photograph": "howto/texture.html",
    "material": "howto/material.html",
    "write a material": "howto/material.html",
    "pixels": "howto/pixels.html",
    "carrier": "howto/carrier.html",
    "studio": "howto/studio.html",
    "web page": "howto/web-page.html",
    "connect a driver": "howto/driver.html",
    "simulate": "howto/simulate.html",
    "voltage for a friction": "howto/friction.html",
    "friction for a voltage": "howto/friction.html",
    "save a surface": "howto/surface.html",
    "tolerance": "howto/tolerance.html",
    "choose terms": "howto/terms.html",
    "own finger": "howto/finger.html",
    "run an experiment": "howto/experiment.html",
    "stimuli": "howto/stimuli.html",
    "slider": "howto/slider.html",
    "stop": "howto/stop.html",
    "plot": "howto/plot.html",
    "FrictionSurface.build": "reference/haptix.model.html#haptix.model.FrictionSurface.build",
    "ContactModel.solve": "reference/haptix.model.html#haptix.model.ContactModel.solve",
    "install": "index.html",
    "safety": "safety.html",
    "glossary": "glossary.html",
    "latency": "rendering.html",
    "jitter": "rendering.html",
    "wire format": "protocol.html",
    "psychopy": "stimuli.html",
}
# Words that lead to one of the first three pages.
NEWCOMER = {
    "voltage limit": "safety.html",
    "rotate screen": "howto/pixels.html",
    "multi touch": "rendering.html",
    "own texture": "textures.html",
    "carrier frequency": "howto/carrier.html",
    "export wav": "howto/simulate.html",
    "psychophysics": "howto/experiment.html",
    "usb permission": "devices.html",
    "install windows": "index.html",
    "emergency stop": "howto/stop.html",
    "two fingers": "rendering.html",
    "dpi": "howto/pixels.html",
    "load image": "howto/texture.html",
    "javascript": "howto/web-page.html",
    "c#": "clients.html",
    "error message": "reference/haptix.base.errors.html",
    "gpu": "index.html",
    "maximum friction": "howto/friction.html",
    "noise texture": "textures.html",
    "measure friction": "howto/calibrate.html",
    "save layout": "layouts.html",
    "wet finger": "howto/finger.html",
    "humidity": "calibration.html",
    "what is JND": "howto/tolerance.html",
    "button": "materials.html",
    "logging": "log.html",
    "license": "index.html",
    "bids": "experiment.html",
}


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *arguments):
        pass


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder of the built site; .ci/run has built it already and names it."""
    if built := os.environ.get("HAPTIX_SITE"):
        return ROOT / built
    site = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "-d", str(site)], cwd=ROOT, check=False,
        capture_output=True, text=True, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
    )  # fmt: skip
    assert not done.returncode, done.stderr
    return site


@pytest.fixture(scope="module")
def address(site):
    handler = functools.partial(Quiet, directory=str(site))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}/"
        server.shutdown()


@pytest.fixture(scope="module")
def browser():
    with chromium() as browser:
        yield browser


@pytest.fixture(scope="module")
def search(address, browser):
    """A function that types words into the site's search and returns the first links.

    The page is loaded once, since it takes a second to make its index.
    """
    page = browser.new_page()
    found = page.locator(".md-search-result__link")

    def types(words):
        page.evaluate(
            "words => { const box = document.querySelector('[data-md-component=search-query]');"
            "box.value = words; box.dispatchEvent(new KeyboardEvent('keyup')) }",
            words,
        )

    # In the address: words that are typed before the page's script has begun to listen are lost.
    page.goto(f"{address}index.html?q=haptix")
    found.first.wait_for(state="attached", timeout=120_000)

    def links(words):
        types("")  # what was found for the last words cannot be taken for this
        found.first.wait_for(state="detached")
        types(words)
        found.first.wait_for(state="attached")
        hrefs = found.evaluate_all("links => links.map(link => link.href)")
        return [re.sub(r"\?[^#]*", "", href.removeprefix(address)) for href in hrefs]

    return links


@pytest.mark.slow
def test_the_front_page_is_felt_without_a_service(address, browser):
    page, asked, errors = browser.new_page(), [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: errors.append(error))
    page.goto(f"{address}index.html")
    figure = page.locator(".felt")
    page.wait_for_function("document.querySelector('.felt').dataset.state")
    assert figure.get_attribute("data-state") == "ready"
    pad = page.locator(".felt-pad")
    pad.scroll_into_view_if_needed()
    box = pad.bounding_box()
    page.evaluate(
        "(() => { window.seen = []; const outputs = [...document.querySelectorAll('.felt output')];"
        "const keep = () => seen.push(outputs.map(output => output.textContent));"
        "new MutationObserver(keep).observe(outputs[1], { childList: true }) })()"
    )
    for stroke in count():  # across the joints, there and back
        for step in range(60):
            part = 0.1 + 0.8 * abs(step - 30) / 30
            page.mouse.move(box["x"] + part * box["width"], box["y"] + 0.6 * box["height"])
            page.wait_for_timeout(8)
        seen = page.evaluate("seen")
        numbers = np.array([row for row in seen if "\u2013" not in row], float)
        # A busy page shows few places, and perhaps no joint among the first.
        grips = len(numbers) > 20 and np.ptp(numbers, axis=0).min() > 0.02
        if grips or stroke == 50:
            break
    assert grips  # the bright joints
    # What is felt follows what is wanted, up to the edges that no drive can follow.
    assert np.median(np.abs(numbers[:, 0] - numbers[:, 1])) < 0.005
    drawn = page.evaluate(
        "(() => { const c = document.querySelector('.felt canvas');"  # its worker draws there
        "const copy = new OffscreenCanvas(c.width, c.height).getContext('2d');"
        "copy.drawImage(c, 0, 0); return copy.getImageData(0, 0, c.width, c.height).data"
        ".filter((value, i) => i % 4 === 3 && value > 0).length })()"
    )
    assert drawn > 1000
    # Its 45 mm are those of the glass once a person has measured it, here 4 pixels in each.
    page.get_by_label("Width of the picture").fill(f"{box['width'] / 4:.3f}")
    page.keyboard.press("Enter")
    assert pad.bounding_box()["width"] == pytest.approx(180.0, abs=0.1)
    assert errors == []
    assert all(url.startswith((address, "blob:")) for url in asked)


@pytest.mark.slow
def test_the_pages_of_the_gallery_show_what_their_programs_drew(site):
    pages = sorted((ROOT / "docs" / "gallery").glob("*.md"))
    assert len(pages) == 8
    for page in pages:
        text, built = (
            page.read_text("utf-8"),
            (site / "gallery" / f"{page.stem}.html").read_text("utf-8"),
        )
        drawn = re.findall('<img alt="[^"]+" src="data:image/png;base64,([^"]+)"', built)
        assert len(drawn) == text.count("gallery_pictures") > 0
        for one in drawn:
            assert np.ptp(imread(io.BytesIO(base64.b64decode(one)))) > 0.5, page.name  # not blank
        assert "Traceback" not in built


@pytest.mark.slow
@pytest.mark.parametrize("words", SEARCHES)
def test_a_search_leads_to_the_page_that_answers_it(search, words):
    page, _, section = SEARCHES[words].partition("#")
    first = search(words)[:2]
    assert first[0] == page
    if section:  # the results of a page begin with the page
        assert first[1] == SEARCHES[words]


@pytest.mark.slow
@pytest.mark.parametrize("words", NEWCOMER)
def test_what_a_newcomer_types_leads_to_the_page_among_three(search, words):
    pages = list(dict.fromkeys(link.partition("#")[0] for link in search(words)))
    assert NEWCOMER[words] in pages[:3]
