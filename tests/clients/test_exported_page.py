"""A layout as a folder for a web server: served by Python's own, stroked in Chromium."""

import base64
import io
import json
import re
import subprocess
import sys
import zipfile
from contextlib import contextmanager
from functools import partial

import numpy as np
import pytest
from PIL import Image

from haptix.feel.gallery import ASSETS, load
from haptix.play.touch_page import page_files
from haptix.service.worker.document_work import DocumentWork
from tests.chromium import chromium, zoomed_page
from tests.command_line import run_haptix
from tests.play.render.engines import Engine
from tests.waiting import wait_for

OPENING = {"surface": None, "finger": "semi-wet", "screen": "3m-sct3250"}
#: Two fields, each of one friction; the layout begins away from the origin.
FIELDS = [(20.0, 0.25), (50.0, 0.75)]
WIDTH_MM, HEIGHT_MM = 20.0, 30.0
LAYOUT = {
    "regions": [
        {
            "name": f"field {number}",
            "material": {
                "kind": "grating", "wave": "square", "period_mm": 1.0,
                "low": share, "high": share + 1e-4,
            },
            "x_mm": x_mm,
            "y_mm": 10.0,
            "width_mm": WIDTH_MM,
            "height_mm": HEIGHT_MM,
        }
        for number, (x_mm, share) in enumerate(FIELDS)
    ]
}  # fmt: skip


@contextmanager
def served(folder):
    """The address of a folder that `python -m http.server` serves."""
    command = [sys.executable, "-u", "-m", "http.server", "0", "--bind", "127.0.0.1"]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True) as server:
        try:
            yield re.search(r"http://\S+/", server.stdout.readline())[0]
        finally:
            server.terminate()


def exported(title):
    """The archive that the studio is given."""
    document = {"kind": "layout", **LAYOUT}
    work = DocumentWork(ASSETS, OPENING)
    answer = work.export(document=document, form="page", title=title, reachable_mu=(0.0, 1.0))
    return zipfile.ZipFile(io.BytesIO(base64.b64decode(answer["content"])))


def feels(page, x_mm, due):
    """Whether the page shows this wanted and felt friction of a mouse that moves around a place."""
    box = page.locator(".felt-pad").bounding_box()
    scale = box["width"] / (FIELDS[1][0] + WIDTH_MM - FIELDS[0][0])
    for step in range(20):
        # To and fro, and fast enough on a busy machine: a finger at rest feels nothing.
        x = box["x"] + scale * (x_mm - FIELDS[0][0] + 6.0 * abs(step % 4 - 2) / 2)
        page.mouse.move(x, box["y"] + box["height"] / 2)
        page.wait_for_timeout(10)
    texts = page.locator("output").all_inner_texts()
    shown = [float(text) if text != "–" else np.nan for text in texts]
    return shown == pytest.approx(due, abs=6e-4)


def played_at(engine, x_mm):
    """Wanted and felt friction of the engine in C, for a stroke to a place."""
    for step in range(40):
        at_s, to_mm = engine.block(1).first_sample / 48_000, x_mm - 0.1 * (40 - step)
        engine.touch(1, at_s, to_mm, 25.0, 0.0, True)
        block = engine.block(60)
    return [block.wanted_mu[-1], block.felt_mu[-1]]


@pytest.mark.slow  # the command below writes the same page
def test_a_layout_of_the_studio_is_stroked_without_a_service(tmp_path):
    exported("Two <fields>").extractall(tmp_path / "site")
    engine = Engine((tmp_path / "site" / "touch.hxp").read_bytes())
    with served(tmp_path / "site") as address, chromium() as browser:
        page = browser.new_page()
        errors, asked = [], []
        page.on("pageerror", lambda error: errors.append(error))
        page.on("request", lambda request: asked.append(request.url))
        page.goto(address)
        wait_for(lambda: page.locator("figure").get_attribute("data-state") == "ready")
        assert page.title() == "Two <fields>"
        assert page.locator("img").evaluate("(image) => image.naturalWidth") > 100
        dues = [played_at(engine, x_mm + 8.0) for x_mm, _ in FIELDS]
        assert dues[1][1] - dues[0][1] > 0.03  # half of what the screen can give
        for (x_mm, _), due in zip(FIELDS, dues, strict=True):
            is_felt = partial(feels, page, x_mm + 7.0, due)
            wait_for(is_felt, 60.0)
        # It asks nobody but its server.
        assert all(url.startswith((address, "data:", "blob:")) for url in asked)
        assert errors == []


def test_the_command_writes_the_same_page(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "two.json").write_text(
        json.dumps({"schema_version": 1, "kind": "layout", **LAYOUT})
    )
    done = run_haptix("compile", "two.json", "--page", "site")
    assert done.code == 0, done.err
    archive = exported("two")
    written = {path.name: path.read_bytes() for path in (tmp_path / "site").iterdir()}
    assert written == {name: archive.read(name) for name in archive.namelist()}
    again = run_haptix("compile", "two.json", "--page", "site")
    assert again.code != 0
    assert "site has files: name another folder, or pass --overwrite" in again.err
    assert run_haptix("compile", "two.json", "--page", "site", "--overwrite").code == 0
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "index.html").write_text("a page of somebody's")
    assert run_haptix("compile", "two.json", "--page", "own").code != 0
    assert [path.name for path in (tmp_path / "own").iterdir()] == ["index.html"]


@pytest.mark.slow
def test_the_picture_is_as_large_as_the_layout_once_it_was_measured(tmp_path):
    """Asked once: the page knows it again after a restart, and however a person zooms.

    The glass has 5 device pixels per mm, which a ruler on the picture shows. `screen.width` of
    Chromium is the same however a page is zoomed, so it cannot tell.
    """
    exported("Two").extractall(tmp_path / "site")
    layout_mm = FIELDS[1][0] + WIDTH_MM - FIELDS[0][0]

    def wide_mm(page):  # what a ruler on the glass shows
        box = page.locator(".felt-pad").bounding_box()
        return box["width"] * page.evaluate("devicePixelRatio") / 5.0

    with served(tmp_path / "site") as address:
        with zoomed_page(tmp_path / "person", 1.1) as page:
            page.goto(address)
            told = page.locator(".felt-size")
            told.wait_for()
            assert "not those on the glass" in told.inner_text()
            page.get_by_label("Width of the picture").fill(f"{wide_mm(page):.2f}")
            page.keyboard.press("Enter")
            assert "To scale" in told.inner_text()
            assert wide_mm(page) == pytest.approx(layout_mm, rel=0.01)
        with zoomed_page(tmp_path / "person", 1.5) as page:
            page.goto(address)
            told = page.locator(".felt-size")
            told.wait_for()
            assert "To scale" in told.inner_text()
            assert wide_mm(page) == pytest.approx(layout_mm, rel=0.01)
            page.evaluate("document.body.style.width = '80px'")
            page.evaluate("dispatchEvent(new Event('resize'))")
            assert "too small" in told.inner_text()


def test_a_background_is_shown_around_the_regions():
    """The groove is a strip from 17.5 to 27.5 mm, in a rough plane that is felt as well."""
    files = page_files(b"", load("gallery:groove"), "Groove")
    assert 'data-felt="0 0 60"' in files["index.html"].decode()
    with Image.open(io.BytesIO(files["picture.png"])) as image:
        levels = np.asarray(image)
    assert levels.shape == (360, 720)  # of 30 mm, and of 60
    assert levels[:200].std() > 10 * levels[215:325].std()


def test_a_phone_shows_picture_and_curve_at_once_and_can_be_scrolled(tmp_path):
    for name, content in page_files(b"", load("gallery:comb"), "Ribs").items():
        (tmp_path / name).write_bytes(content)
    with served(tmp_path) as address, chromium() as browser:
        page = browser.new_page(viewport={"width": 360, "height": 640})
        page.goto(address)
        page.locator("figure[data-state=failed]").wait_for()  # no program
        pad, curve = (page.locator(one).bounding_box() for one in (".felt-pad", ".felt-curve"))
        assert curve["y"] + curve["height"] <= pad["y"]  # a hand is below its finger
        assert pad["y"] + pad["height"] <= 640
        assert pad["width"] <= 0.8 * 360  # a finger on it does not scroll
        assert page.evaluate("document.documentElement.scrollWidth") <= 360
