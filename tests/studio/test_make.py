"""The page that makes layouts, as a stranger uses it: from a photograph to an exported layout."""

import asyncio
import io
import json
import zipfile

import pytest
from skimage import data
from skimage.io import imsave

from haptix.errors import HaptixError
from haptix.gallery import ASSETS
from haptix.service.assets import AssetStore
from haptix.service.document_work import DocumentWork
from haptix.service.messages import Problem
from haptix.service.rest import documents_router
from tests.studio.conftest import a_front, a_page, address, keep, violations
from tests.waiting import wait_for


class PoolHere:
    """Answers in this process, by the code of the workers."""

    def __init__(self, assets):
        store = AssetStore(assets)
        store.keep(ASSETS)
        opening = {"surface": None, "finger": "semi-wet", "screen": "3m-sct3250"}
        self.work, self.turn = DocumentWork(store.folder, opening), asyncio.Lock()

    async def ask(self, owner, do, **fields):
        try:
            async with self.turn:
                return await asyncio.to_thread(getattr(self.work, do), **fields)
        except HaptixError as error:
            raise Problem("document", str(error)) from None


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """A front whose engine writes down what it is told; all else is real."""
    folder = tmp_path_factory.mktemp("service")
    routes = documents_router(PoolHere(folder / "assets"), folder / "kept")
    with a_front(folder, routes) as service:
        yield service


@pytest.fixture
def maker(served):
    """The same front, with nothing told and no layout kept."""
    wait_for(lambda: not served.hub.sessions)
    served.engine.__init__()
    for kept in (served.folder / "kept").glob("*.json"):
        kept.unlink()
    return served


@pytest.fixture
def page(maker, browser):
    """The page, with its gallery."""
    with a_page(browser) as page:
        page.goto(address(maker))
        page.get_by_role("link", name="Make").click()
        page.locator(".thumb").first.wait_for()
        yield page


def known(service):
    """The regions that the engine has, by name: what it was told, taken together."""
    found = {}
    for do, fields, _ in service.engine.told:
        if do == "layout_set":
            regions = [dict(one) for one in fields["document"]["regions"]]
            found = {one.pop("name"): one for one in regions}
        elif do == "layout_change":
            for op in fields["ops"]:
                op = dict(op)
                kind, name = op.pop("op"), op.pop("name")
                op.pop("over_s", None)  # how a move glides
                if kind == "remove":
                    del found[name]
                else:
                    found.setdefault(name, {}).update(op)
    return found


def until(page, true):
    """Wait for what the page causes elsewhere."""
    for _ in range(600):
        if true():
            return
        page.wait_for_timeout(50)
    pytest.fail("it did not come about in 30 s")


@pytest.fixture(scope="module")
def brick(tmp_path_factory):
    path = tmp_path_factory.mktemp("photographs") / "brick.png"
    imsave(path, data.brick()[::4, ::4])
    return path


EXPORTED = {
    "Friction map": {"png", "json"},
    "Drive as WAV": {"wav", "json"},
    "AHAP": {"ahap", "json"},
    "HJIF": {"hjif", "json"},
}
"""What each form has in its archive: the file, and what it means or lacks."""


@pytest.mark.slow  # a whole journey; its steps are tested one by one below
def test_a_stranger_makes_stripes_that_move_a_button_and_a_slider_of_a_photograph(
    maker, page, brick
):
    while page.get_by_label("Remove").count():
        page.get_by_label("Remove").first.click()
    page.get_by_label("Add a file").set_input_files(brick)
    page.get_by_role("heading", name="Parameters of brick").wait_for()
    page.get_by_text("just-noticeable differences").wait_for()
    page.get_by_role("button", name="Moving stripes.").click()
    page.get_by_label("Velocity").fill("-30, 0")
    page.get_by_label("Velocity").press("Enter")
    page.get_by_role("button", name="Button.").click()
    page.get_by_role("button", name="Slider.").click()
    until(page, lambda: set(known(maker)) == {"brick", "Moving stripes", "Button", "Slider"})
    until(page, lambda: known(maker)["Moving stripes"]["material"]["velocity_mm_s"] == [-30, 0])
    assert known(maker)["brick"]["height_mm"] == 60.0  # the picture is a square of 60 mm
    places = [(one["x_mm"], one["y_mm"]) for one in known(maker).values()]
    assert len(set(places)) == 4
    keep(page, "make")
    assert not violations(page)
    page.get_by_text("saved as untitled").wait_for()
    page.get_by_text("Export").click()
    with page.expect_download() as download:
        page.get_by_role("button", name="Document").click()
    archive = zipfile.ZipFile(io.BytesIO(download.value.path().read_bytes()))
    exported = json.loads(archive.read("layout.json"))
    assert [one["name"] for one in exported["regions"]] == [*known(maker)]
    assert sum(name.startswith("assets/") for name in archive.namelist()) == 1
    for form, names in EXPORTED.items():
        page.get_by_text("Export", exact=True).click()
        with page.expect_download() as download:
            page.locator(".menu button", has=page.get_by_text(form, exact=True)).click()
        archive = zipfile.ZipFile(io.BytesIO(download.value.path().read_bytes()))
        assert names <= {name.rsplit(".", 1)[-1] for name in archive.namelist()}, form
    page.reload()
    page.get_by_role("button", name="Open").or_(page.locator("summary", has_text="Open")).click()
    page.get_by_role("button", name="untitled").click()
    page.locator("button.region").nth(3).wait_for()


def test_a_file_that_is_no_picture_becomes_no_region(maker, page, tmp_path):
    before = page.locator("button.region").count()
    for name, content, told in [
        ("holiday.png", b"this is no picture", "holiday.png was not added"),
        ("notes.txt", b"hello", "expected a file that ends in"),
    ]:
        path = tmp_path / name
        path.write_bytes(content)
        page.get_by_label("Add a file").set_input_files(path)
        page.locator(".gallery .told", has_text=told).wait_for()
    assert page.locator("button.region").count() == before
    page.expected_errors.clear()  # the browser tells of the refused request


def test_regions_are_moved_sized_drawn_and_removed_and_all_is_taken_back(maker, page):
    ribs = page.locator('button.region[aria-label^="Ribs"]')
    until(page, lambda: len(known(maker)) == 4)
    begin = known(maker)
    box = ribs.bounding_box()
    page.mouse.move(box["x"] + 20, box["y"] + 20)
    page.mouse.down()
    page.mouse.move(box["x"] + 60, box["y"] + 20, steps=4)
    page.mouse.up()
    until(page, lambda: known(maker)["Ribs"]["x_mm"] > 2)
    moved = known(maker)["Ribs"]["x_mm"]
    ribs.focus()
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Shift+ArrowRight")
    until(page, lambda: known(maker)["Ribs"]["width_mm"] == 57)
    assert known(maker)["Ribs"]["x_mm"] == moved
    assert known(maker)["Ribs"]["y_mm"] == 1
    page.keyboard.press("Delete")
    until(page, lambda: "Ribs" not in known(maker))
    plane = page.locator(".board").bounding_box()
    page.mouse.move(plane["x"] + 20, plane["y"] + 20)
    page.mouse.down()
    page.mouse.move(plane["x"] + 120, plane["y"] + 90, steps=4)
    page.mouse.up()
    until(page, lambda: "Ribs" in known(maker))
    assert known(maker)["Ribs"]["width_mm"] < 40
    for _ in range(5):
        page.keyboard.press("Control+z")
    until(page, lambda: known(maker) == begin)
    page.keyboard.press("Control+y")
    until(page, lambda: known(maker)["Ribs"]["x_mm"] == moved)


def test_a_parameter_is_felt_at_once_and_headroom_is_shown(maker, page):
    page.locator('button.region[aria-label^="Ribs"]').focus()
    period = page.get_by_label("Period", exact=True)
    period.fill("3.5")
    period.press("Tab")
    until(page, lambda: known(maker)["Ribs"]["material"]["period_mm"] == 3.5)
    page.get_by_text("JND at a place").first.wait_for()
    page.get_by_role("button", name="Headroom").click()
    page.get_by_text("All that is asked for can be given").wait_for()
    page.get_by_label("Target").select_option("mu")
    page.locator(".parameters .told", has_text="expected low and high").wait_for()
    page.get_by_label("Low", exact=True).fill("0.1")
    page.get_by_label("Low", exact=True).press("Tab")
    page.get_by_label("High", exact=True).fill("0.9")
    page.get_by_label("High", exact=True).press("Tab")
    page.locator(".reach", has_text="for too much").wait_for()
    keep(page, "headroom")
    page.get_by_label("Let it change").select_option("moving")
    until(page, lambda: known(maker)["Ribs"]["material"]["kind"] == "moving")
    assert known(maker)["Ribs"]["material"]["of"]["period_mm"] == 3.5
    page.expected_errors.clear()  # the browser tells of the refused check


@pytest.mark.parametrize(
    ("width", "theme"),
    [
        (360, "light"),
        pytest.param(1280, "dark", marks=pytest.mark.slow),
        pytest.param(1920, "light", marks=pytest.mark.slow),
    ],
)
def test_the_page_fits_and_is_legible(maker, page, width, theme):
    page.set_viewport_size({"width": width, "height": 800 if width > 400 else 740})
    page.evaluate(f"document.documentElement.dataset.theme = {theme!r}")
    page.locator('button.region[aria-label^="Sand"]').focus()
    page.get_by_text("just-noticeable differences").wait_for()
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert not violations(page)
    keep(page, f"make-{width}-{theme}")
