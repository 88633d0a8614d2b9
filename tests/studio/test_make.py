"""The page that makes layouts, as a stranger uses it: from a photograph to an exported layout."""

import asyncio
import io
import itertools
import json
import os
import random
import re
import shutil
import zipfile

import numpy as np
import pytest
from PIL import Image
from skimage import data
from skimage.io import imsave

from haptix.base.errors import HaptixError
from haptix.feel.gallery import ASSETS
from haptix.feel.materials import schema
from haptix.service.front.assets import AssetStore
from haptix.service.front.rest import documents_router
from haptix.service.protocol.messages import Problem
from haptix.service.worker.document_work import DocumentWork
from tests.clients.test_exported_page import served as served_folder
from tests.service.service_under_test import is_reached
from tests.studio.conftest import a_front, a_page, address, keep, violations
from tests.waiting import wait_for

BUSY = {"type": "error", "code": "device", "sentence": "the engine is not there yet"}
SEQUENCES = int(os.environ.get("HAPTIX_SEQUENCES", "6"))


class PoolHere:
    """Answers in this process, by the code of the workers."""

    def __init__(self, assets):
        store = AssetStore(assets)
        store.keep(ASSETS)
        opening = {"finger": "semi-wet", "screen": "3m-sct3250"}
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
    routes = documents_router(PoolHere(folder / "assets"), folder / "kept", is_reached)
    with a_front(folder, routes) as service:
        service.hub.schema = schema()
        yield service


@pytest.fixture
def maker(served):
    """The same front, with nothing told and no layout kept."""
    wait_for(lambda: not served.hub.sessions)
    served.engine.__init__()
    served.access._tries.clear()  # each test pairs a page of its own
    for kept in (*(served.folder / "kept").iterdir(), *(served.folder / "drafts").iterdir()):
        shutil.rmtree(kept, ignore_errors=True)  # the page before may still send its last draft
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
    page.get_by_text("draft saved").wait_for()
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
    page.locator("button.region").nth(3).wait_for()


@pytest.mark.parametrize("form", ["webp", "avif"])
def test_pictures_of_the_web_become_regions(maker, page, tmp_path, form):
    path = tmp_path / f"wall {form}.{form}"
    Image.fromarray(data.brick()[::4, ::4]).save(path)
    page.get_by_label("Add a file").set_input_files(path)
    page.get_by_role("heading", name=f"Parameters of wall {form}").wait_for()
    until(page, lambda: f"wall {form}" in known(maker))
    assert known(maker)[f"wall {form}"]["height_mm"] == 60.0  # the picture is a square of 60 mm
    page.get_by_text("just-noticeable differences").wait_for()  # so it was decoded and drawn


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
    page.get_by_role("button", name="Draw", exact=True).click()
    drag(page, (20, 20), (120, 90))
    until(page, lambda: "Ribs" in known(maker))
    assert known(maker)["Ribs"]["width_mm"] < 40
    for _ in range(5):
        page.keyboard.press("Control+z")
    until(page, lambda: known(maker) == begin)
    page.keyboard.press("Control+y")
    until(page, lambda: known(maker)["Ribs"]["x_mm"] == moved)


def drag(page, begin, end, *keys):
    """Drag from a place of the board to another one [px], while keys are held."""
    plane = page.locator(".board").bounding_box()
    for key in keys:
        page.keyboard.down(key)
    page.mouse.move(plane["x"] + begin[0], plane["y"] + begin[1])
    page.mouse.down()
    page.mouse.move(plane["x"] + end[0], plane["y"] + end[1], steps=4)
    page.mouse.up()
    for key in keys:
        page.keyboard.up(key)


def chosen(page):
    """Names of the regions that are chosen."""
    pressed = page.locator("button.region[aria-pressed=true]")
    labels = pressed.evaluate_all("all => all.map((one) => one.ariaLabel)")
    return {label.split(":")[0] for label in labels}


def region(page, name):
    return page.locator(f'button.region[aria-label^="{name}:"]')


def edit(page, command):
    """Give a command by the menu."""
    page.locator("summary", has_text="Edit").click()
    page.locator(".menu button", has_text=command).click()


def test_several_regions_are_chosen_moved_copied_and_removed_by_keys(maker, page):
    until(page, lambda: len(known(maker)) == 4)
    begin = known(maker)
    region(page, "Ribs").click()
    region(page, "Sand").click(modifiers=["Shift"])
    assert chosen(page) == {"Ribs", "Sand"}
    page.keyboard.press("ArrowDown")
    until(page, lambda: known(maker)["Sand"]["y_mm"] == 1)
    assert known(maker)["Ribs"]["y_mm"] == 1 and known(maker)["Button"] == begin["Button"]
    page.keyboard.press("Control+z")  # one step for both
    until(page, lambda: known(maker) == begin)
    page.keyboard.press("Control+d")
    until(page, lambda: len(known(maker)) == 6)
    assert chosen(page) == {"Ribs 2", "Sand 2"}
    copy = known(maker)["Sand 2"]
    assert copy == begin["Sand"] | {"x_mm": 64, "y_mm": 4}
    page.keyboard.press("Control+c")
    page.keyboard.press("Delete")
    until(page, lambda: known(maker) == begin)
    page.keyboard.press("Control+v")
    until(page, lambda: len(known(maker)) == 6)
    assert known(maker)["Sand 2"]["x_mm"] == 68
    page.keyboard.press("Control+v")
    until(page, lambda: {"Ribs 3", "Sand 3"} <= set(known(maker)))
    page.keyboard.press("Control+a")
    assert len(chosen(page)) == 8
    page.keyboard.press("Delete")
    until(page, lambda: not known(maker))
    for _ in range(5):  # the removal, two pastes, the other removal, the copies
        page.keyboard.press("Control+z")
    until(page, lambda: known(maker) == begin)


def test_regions_are_chosen_by_a_frame_by_shift_and_in_the_list(maker, page):
    sand, slider = (region(page, name).bounding_box() for name in ("Sand", "Slider"))
    plane = page.locator(".board").bounding_box()
    right = sand["x"] + sand["width"] + 10 - plane["x"]
    drag(page, (right, 12), (sand["x"] + 30 - plane["x"], slider["y"] - plane["y"] - 4))
    assert chosen(page) == {"Sand"}
    bottom = slider["y"] + slider["height"] + 8 - plane["y"]
    drag(page, (right, bottom), (2, slider["y"] + 20 - plane["y"]), "Shift")
    assert chosen(page) == {"Sand", "Slider", "Button"}
    assert len(known(maker)) == 4  # a frame draws no region
    region(page, "Button").click(modifiers=["Shift"])
    assert chosen(page) == {"Sand", "Slider"}
    page.get_by_text("2 regions are chosen").wait_for()
    before = known(maker)
    box = region(page, "Sand").bounding_box()
    drag(
        page,
        (box["x"] + 30 - plane["x"], box["y"] + 30 - plane["y"]),
        (box["x"] + 50 - plane["x"], box["y"] + 30 - plane["y"]),
    )
    until(page, lambda: known(maker)["Sand"] != before["Sand"])
    moves = {name: known(maker)[name]["x_mm"] - before[name]["x_mm"] for name in before}
    assert moves["Sand"] == moves["Slider"] > 0 == moves["Ribs"] == moves["Button"]
    region(page, "Sand").click()  # without a move it is the only one
    assert chosen(page) == {"Sand"}
    page.locator(".order .name", has_text="Ribs").focus()
    page.keyboard.press("Shift+Enter")
    assert chosen(page) == {"Sand", "Ribs"}
    page.keyboard.press("Shift+Enter")  # the list is another one now, and has the focus
    assert chosen(page) == {"Sand"}
    page.keyboard.press("Escape")
    assert not chosen(page)


def test_a_region_is_renamed_and_has_its_old_name_after_undo(maker, page):
    until(page, lambda: len(known(maker)) == 4)
    begin = known(maker)
    region(page, "Sand").click()
    page.keyboard.press("F2")
    page.keyboard.type("Beach")
    page.keyboard.press("Enter")
    until(page, lambda: "Beach" in known(maker))
    assert list(known(maker)) == ["Ribs", "Beach", "Slider", "Button"]
    assert known(maker)["Beach"] == begin["Sand"]
    page.get_by_role("heading", name="Parameters of Beach").wait_for()
    page.keyboard.press("ArrowRight")  # the region has the focus again
    until(page, lambda: known(maker)["Beach"]["x_mm"] == 61)
    page.keyboard.press("F2")
    for refused in ("Ribs", "a\u0007b", ""):
        page.locator("#r-name").fill(refused)
        page.keyboard.press("Enter")
        assert not page.locator("#r-name").evaluate("one => one.validity.valid")
    page.keyboard.press("Escape")
    page.keyboard.press("Control+z")
    page.keyboard.press("Control+z")
    until(page, lambda: known(maker) == begin)
    assert chosen(page) == {"Sand"}


def test_regions_are_grouped_moved_copied_and_aligned_as_one(maker, page):
    until(page, lambda: len(known(maker)) == 4)
    begin = known(maker)
    region(page, "Ribs").click()
    region(page, "Slider").click(modifiers=["Shift"])
    page.keyboard.press("Control+g")
    page.keyboard.press("Escape")
    region(page, "Ribs").click()
    assert chosen(page) == {"Ribs", "Slider"}
    page.keyboard.press("ArrowRight")
    until(page, lambda: known(maker)["Slider"]["x_mm"] == 1)
    assert known(maker)["Ribs"]["x_mm"] == 1 and known(maker)["Sand"] == begin["Sand"]
    region(page, "Sand").click()
    assert chosen(page) == {"Sand"}
    region(page, "Slider").click(modifiers=["Shift"])
    assert chosen(page) == {"Sand", "Ribs", "Slider"}
    edit(page, "Align bottom")  # the group moves as one: the slider's end is its own
    until(page, lambda: known(maker)["Sand"]["y_mm"] == 56 - 34)
    assert known(maker)["Ribs"]["y_mm"] == 0 and known(maker)["Slider"]["y_mm"] == 40
    region(page, "Slider").click(modifiers=["Shift"])
    assert chosen(page) == {"Sand"}
    region(page, "Slider").click()
    page.keyboard.press("Control+d")
    until(page, lambda: len(known(maker)) == 6)
    region(page, "Ribs 2").click()
    assert chosen(page) == {"Ribs 2", "Slider 2"}  # the copies are a group of their own
    names = page.locator(".order")
    assert names.get_by_text("Group 2").count() == names.get_by_text("Group", exact=True).count()
    names.get_by_role("button", name="Ribs 2 Group 2", exact=True).click()
    assert chosen(page) == {"Ribs 2"}  # of the list one alone
    region(page, "Ribs 2").click()
    page.keyboard.press("Control+Shift+g")
    assert names.get_by_text("Group 2").count() == 0
    page.keyboard.press("Escape")
    region(page, "Ribs 2").click()
    assert chosen(page) == {"Ribs 2"}
    page.keyboard.press("Control+z")  # the ungrouping
    region(page, "Ribs 2").click()
    assert chosen(page) == {"Ribs 2", "Slider 2"}
    page.keyboard.press("Control+s")
    page.get_by_text("kept as untitled").wait_for()
    page.reload()
    region(opened(page), "Slider").focus()  # as by the Tab key
    assert chosen(page) == {"Ribs", "Slider"}
    assert not violations(page)


def test_regions_are_aligned_and_get_the_same_gaps(maker, page):
    page.keyboard.press("Control+a")
    begin = known(maker)
    edit(page, "Align right")
    until(page, lambda: {one["x_mm"] + one["width_mm"] for one in known(maker).values()} == {116})
    edit(page, "Align middle")
    until(
        page, lambda: {one["y_mm"] + one["height_mm"] / 2 for one in known(maker).values()} == {28}
    )
    page.keyboard.press("Control+z")
    page.keyboard.press("Control+z")
    until(page, lambda: known(maker) == begin)
    edit(page, "Same gaps from left to right")
    until(page, lambda: known(maker) != begin)
    spans = sorted(
        ((one["x_mm"], one["x_mm"] + one["width_mm"]) for one in known(maker).values()),
        key=lambda span: span[0] + span[1],
    )
    gaps = [after[0] - before[1] for before, after in itertools.pairwise(spans)]
    assert max(gaps) - min(gaps) < 0.01  # places are rounded to 0.001 mm
    assert (spans[0][0], spans[-1][1]) == (0, 116)
    region(page, "Ribs").click()
    page.locator("summary", has_text="Edit").click()
    until(page, page.locator(".menu button", has_text="Align left").is_disabled)  # once it is open
    assert not violations(page)


def share_of(page, is_so):
    """Share of the board's opaque points whose colour is so, for a condition in JavaScript."""
    script = """(is_so) => {
        const canvas = document.querySelector(".board canvas");
        const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
        let [all, found] = [0, 0];
        for (let at = 0; at < data.length; at += 28) {
            const [r, g, b, alpha] = data.subarray(at, at + 4);
            if (alpha === 255) [all, found] = [all + 1, found + is_so(r, g, b)];
        }
        return found / all;
    }"""
    return page.evaluate(f"({script})({is_so})")


def is_red(page):
    return share_of(page, "(r, g, b) => r > 200 && g < 60 && b < 60") > 0.1


def test_the_app_s_picture_lies_beneath_and_is_no_part_of_the_layout(maker, page, tmp_path):
    path = tmp_path / "app.png"
    Image.new("RGB", (400, 300), (255, 0, 0)).save(path)
    until(page, lambda: len(known(maker)) == 4)
    begin = known(maker)
    beneath = page.get_by_label("Show a picture beneath")
    beneath.set_input_files(path)
    until(page, lambda: is_red(page))
    nudge(page)
    name = page.get_by_label("Name of the layout")
    name.fill("desk")
    name.press("Enter")
    page.keyboard.press("Control+s")
    page.get_by_text("kept as desk").wait_for()
    page.reload()
    opened(page).locator("button.region").nth(3).wait_for()
    until(page, lambda: is_red(page))  # kept for this layout
    assert known(maker).keys() == begin.keys()
    (document,) = (maker.folder / "kept" / "desk").glob("*.json")
    assert json.loads(document.read_text()).keys() == {"regions"}
    choose(page, "New layout")
    until(page, lambda: not is_red(page))
    path.write_bytes(b"no picture")
    beneath.set_input_files(path)
    page.get_by_text("app.png was not shown").wait_for()
    choose(page, "desk")
    until(page, lambda: is_red(page))
    choose(page, "Keep as a copy")
    page.get_by_text("kept as desk 2").wait_for()
    until(page, lambda: is_red(page))
    edit(page, "Show no picture beneath")
    until(page, lambda: not is_red(page))


def test_friction_is_drawn_in_grey_too(maker, page):
    def coloured():
        return share_of(page, "(r, g, b) => Math.max(r, g, b) - Math.min(r, g, b) > 60")

    grey = page.get_by_role("button", name="Grey")
    until(page, lambda: coloured() > 0.5)
    grey.click()
    until(page, lambda: coloured() < 0.01)  # names of regions are bluish
    page.reload()
    grey.and_(page.locator("[aria-pressed=true]")).wait_for()
    until(page, lambda: coloured() < 0.01)  # a person's choice stays
    grey.click()
    until(page, lambda: coloured() > 0.5)


def test_the_tab_key_is_soon_at_the_first_region(maker, page):
    page.get_by_role("link", name="Make").focus()
    for _ in range(10):
        page.keyboard.press("Tab")
        if chosen(page):
            break
    assert chosen(page) == {"Ribs"}
    page.evaluate("document.activeElement.blur(); document.querySelector('.skip').focus()")
    page.keyboard.press("Enter")
    page.keyboard.press("Escape")
    page.keyboard.press("Tab")
    assert chosen(page) == {"Ribs"}  # at once after "to the page"
    left = page.locator(".gallery").bounding_box()
    bar, board = (page.locator(place).bounding_box() for place in (".bar-of", ".board"))
    assert left["x"] + left["width"] < board["x"] and bar["y"] + bar["height"] < board["y"]


def test_zoom_and_pan_keep_places_true(maker, page):
    board, ribs = page.locator(".board"), region(page, "Ribs")
    until(page, lambda: len(known(maker)) == 4)
    begin, all_of_it = known(maker), ribs.bounding_box()
    x, y = all_of_it["x"] + 5, all_of_it["y"] + 5
    page.mouse.move(x, y)
    page.keyboard.down("Control")
    page.mouse.wheel(0, -400)
    page.keyboard.up("Control")
    until(page, lambda: ribs.bounding_box()["width"] > 2 * all_of_it["width"])
    near = ribs.bounding_box()
    scale = near["width"] / all_of_it["width"]
    assert near["x"] == pytest.approx(x - 5 * scale, abs=1)  # under the pointer nothing moved
    assert near["y"] == pytest.approx(y - 5 * scale, abs=1)
    page.mouse.wheel(30, 20)
    until(page, lambda: ribs.bounding_box()["x"] != near["x"])
    assert ribs.bounding_box()["y"] == pytest.approx(near["y"] - 20, abs=1)
    page.mouse.down(button="middle")
    page.mouse.move(x + 30, y + 20, steps=3)
    page.mouse.up(button="middle")
    until(page, lambda: abs(ribs.bounding_box()["x"] - near["x"]) < 1)
    assert known(maker) == begin and not chosen(page)
    px_per_mm = near["width"] / 56
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 8 * px_per_mm, y, steps=4)
    page.mouse.up()
    until(page, lambda: known(maker)["Ribs"]["x_mm"] == 8)
    assert ribs.bounding_box()["width"] == pytest.approx(near["width"], abs=1)
    page.keyboard.press("Control+z")
    page.get_by_role("button", name=": Show all").click()
    until(page, lambda: ribs.bounding_box() == all_of_it)
    page.get_by_role("button", name="Zoom in").click()
    until(page, lambda: page.locator(".zoom", has_text="150 %").count())
    middle = board.bounding_box()["x"] + board.bounding_box()["width"] / 2
    wide = ribs.bounding_box()
    assert wide["width"] == pytest.approx(1.5 * all_of_it["width"], abs=1)
    assert wide["x"] == pytest.approx(middle - 1.5 * (middle - all_of_it["x"]), abs=1)


def test_the_screen_has_an_outline_where_its_size_is_known(maker, browser):
    edges = """() => {
        const canvas = document.querySelector(".board canvas");
        const context = canvas.getContext("2d");
        const { a, e } = context.getTransform();
        const { data } = context.getImageData(Math.round(a * 67 + e), 0, 1, canvas.height);
        return [...data].filter((_, at) => at % 4 === 3).filter((alpha) => alpha > 200).length;
    }"""
    known_size = maker.hub.inventory.model_copy(update={"screen_mm": (67.0, 45.0)})
    unknown, lengths = maker.hub.inventory, []
    for maker.hub.inventory in (known_size, unknown):
        with a_page(browser) as page:
            page.goto(address(maker))
            page.get_by_role("link", name="Make").click()
            page.locator("summary", has_text="Layouts").click()
            page.get_by_text("New layout", exact=True).click()
            until(page, lambda page=page: not shown(page))
            page.wait_for_timeout(100)
            lengths.append(page.evaluate(edges))
    assert lengths[0] > 100 and lengths[1] < 10


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
        pytest.param(768, "light", marks=pytest.mark.slow),
        pytest.param(1440, "dark", marks=pytest.mark.slow),
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


def test_a_first_visit_is_led_in_five_steps_to_a_layout_of_one_s_own(maker, page):
    says = page.locator(".guide [role=status]")
    says.get_by_text("step 1 of 5").wait_for()
    page.locator(".thumb").first.click()
    says.get_by_text("step 2 of 5").wait_for()
    page.locator('button.region[aria-pressed="true"]').press("ArrowRight")
    says.get_by_text("step 3 of 5").wait_for()
    nudge(page)  # what was done before is done once
    period = page.get_by_label("Period", exact=True)
    period.fill("3.5")
    period.press("Tab")
    says.get_by_text("step 4 of 5").wait_for()
    page.get_by_role("link", name="Go there").click()
    page.locator("main.play .guide").wait_for()
    event = {"event": "contact", "what": "enter", "region": "Ribs", "touch_id": 0, "t_s": 0.0}
    event["session"] = maker.hub.control.holder.layout
    maker.hub.on_engine_event(event)
    says.get_by_text("step 5 of 5").wait_for()
    page.get_by_role("link", name="Go there").click()
    page.get_by_role("button", name="Keep", exact=True).click()
    says.get_by_text("It is yours").wait_for()
    assert not violations(page)
    page.reload()
    says.get_by_text("It is yours").wait_for()
    page.get_by_role("button", name="End the guide").click()
    page.reload()
    opened(page)
    assert page.locator(".guide").is_hidden()


def shown(page):
    """The regions that the page shows, with their places."""
    return sorted(
        page.locator("button.region").evaluate_all("all => all.map((one) => one.ariaLabel)")
    )


def labels_of(document):
    """What a page shows of a document."""
    return sorted(
        "{name}: {width_mm:g} by {height_mm:g} mm, at {x_mm:g}, {y_mm:g} mm".format(**region)
        for region in document["regions"]
    )


def on_service(service):
    """What the drafts, and all versions of kept layouts, show."""
    folders = service.folder.glob("drafts/*")
    drafts = (max(folder.iterdir(), key=lambda path: int(path.stem)) for folder in folders)
    versions = service.folder.glob("kept/*/*.json")
    read = [json.loads(path.read_text()) for path in (*drafts, *versions)]
    kept = [one for one in read if not one.get("removed")]
    return [labels_of(one.get("document", one)) for one in kept]


def newest_kept(service):
    """What the kept layouts show."""
    folders = (service.folder / "kept").iterdir()
    newest = (max(folder.iterdir(), key=lambda path: int(path.stem)) for folder in folders)
    return [labels_of(json.loads(path.read_text())) for path in newest]


def confirmed(page):
    """Wait until the page says that its layout is on the service; what it shows then."""
    page.locator(".hint-of [role=status]", has_text=SAVED).wait_for(state="attached")
    return shown(page)


SAVED = re.compile("^(?!changed|not saved)")


def opened(page):
    """Wait until a page that was loaded shows its layout."""
    page.locator("header .output:not([data-state=connecting], [data-state=lost])").wait_for()
    return page


def choose(page, name):
    """Choose from the menu of layouts."""
    page.locator("summary", has_text="Layouts").click()
    page.locator(".menu button", has_text=name).first.click()


def nudge(page, key="ArrowRight"):
    page.locator('button.region[aria-label^="Ribs"]').focus()
    page.keyboard.press(key)


def kept(service, name):
    """Where the first region of a kept layout lies."""
    versions = (service.folder / "kept" / name).glob("*.json")
    newest = max(versions, key=lambda path: int(path.stem))
    return json.loads(newest.read_text())["regions"][0]["x_mm"]


def test_escape_and_a_click_elsewhere_close_a_menu_and_nothing_else(maker, page):
    opened(page)
    page.locator("header .output[data-state=armed]").wait_for()
    before = len(maker.engine.when("stop"))
    menu, summary = page.locator("details.drop-down[open]"), page.locator("summary.main")
    summary.click()
    assert menu.count() == 1
    page.keyboard.press("Escape")
    assert menu.count() == 0
    assert summary.evaluate("one => one === document.activeElement")
    summary.click()
    page.locator("summary", has_text="Layouts").click()
    assert menu.count() == 1  # the other one
    page.locator("h2").first.click()
    assert menu.count() == 0
    assert len(maker.engine.when("stop")) == before
    region = page.locator('button.region[aria-label^="Ribs"]')
    region.focus()
    summary.click()
    page.keyboard.press("Escape")
    assert region.get_attribute("aria-pressed") == "true"  # the menu was closed, and no more
    page.keyboard.press("Escape")
    assert page.locator("button.region[aria-pressed=true]").count() == 0
    page.keyboard.press("F8")
    page.get_by_text("Off: 0 V").wait_for()
    assert len(maker.engine.when("stop")) == before + 1


@pytest.mark.parametrize("width", [1280, 768, 420])
def test_menus_and_pages_are_in_reach_at_every_width(maker, page, width):
    page.set_viewport_size({"width": width, "height": 900})
    opened(page)
    for summary in page.locator("summary").filter(has_text=re.compile("Layouts|Export")).all():
        summary.click()
        box = page.locator("details.drop-down[open] .menu").bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= width
    for link in page.locator("nav a").all():
        box, nav = link.bounding_box(), page.locator("nav").bounding_box()
        assert box["x"] + box["width"] <= min(width, nav["x"] + nav["width"] + 0.5)


def test_a_reload_and_an_arrow_key_overwrite_no_kept_layout(maker, page):
    page.get_by_label("Name of the layout").fill("desk")
    nudge(page)
    nudge(page)
    page.get_by_role("button", name="Keep", exact=True).click()
    page.get_by_text("kept as desk").wait_for()
    page.reload()
    nudge(opened(page))
    page.get_by_text("draft saved").wait_for()
    assert kept(maker, "desk") == 2
    assert page.get_by_label("Name of the layout").input_value() == "desk"
    page.keyboard.press("Control+s")
    page.get_by_text("kept as desk").wait_for()
    assert kept(maker, "desk") == 3
    choose(page, "revision 1")
    until(page, lambda: any("at 2, 0 mm" in one for one in shown(page)))
    page.keyboard.press("Control+z")  # going back is a change as any other
    until(page, lambda: any("at 3, 0 mm" in one for one in shown(page)))


def test_a_second_page_overwrites_nothing_and_keeps_its_own_beside(maker, page):
    page.keyboard.press("Control+s")
    page.get_by_text("kept as untitled").wait_for()
    other = page.context.new_page()
    other.goto(page.url)
    nudge(opened(other))
    other.get_by_text("draft saved").wait_for()
    nudge(page, "ArrowLeft")
    page.keyboard.press("Control+s")
    page.get_by_text("kept as untitled").wait_for()
    other.keyboard.press("Control+s")
    other.locator(".hint-of", has_text="meanwhile").wait_for()
    assert kept(maker, "untitled") == -1
    other.get_by_role("button", name="Keep as a copy").click()
    other.get_by_text("kept as untitled 2").wait_for()
    assert kept(maker, "untitled 2") == 1
    assert kept(maker, "untitled") == -1
    other.close()
    page.expected_errors.clear()  # the browser tells of the refused request


def test_a_layout_is_renamed_deleted_and_brought_back(maker, page):
    nudge(page)
    page.keyboard.press("Control+s")
    page.get_by_text("kept as untitled").wait_for()
    name = page.get_by_label("Name of the layout")
    name.fill("desk")
    name.press("Enter")
    page.get_by_text("is called desk now").wait_for()
    assert kept(maker, "desk") == 1
    choose(page, "Delete desk")
    page.get_by_text("desk deleted").wait_for()
    page.get_by_role("button", name="Bring desk back").click()
    page.get_by_text("desk opened").wait_for()
    assert name.input_value() == "desk"
    assert kept(maker, "desk") == 1


def test_a_draft_of_ribs_goes_their_way(page):
    """The service's picture may take long; until then horizontal ribs are no vertical ones."""
    page.evaluate(
        """import("/studio/pictures.js").then(({ pictureOf }) => {
            const material = { kind: "grating", period_mm: 4, orientation_deg: 90 };
            const region = { name: "draft", material, width_mm: 20, height_mm: 20 };
            const draft = pictureOf(region, () => {});
            window.draft = draft.getContext("2d").getImageData(0, 0, draft.width, draft.height);
        })"""
    )
    width, levels = page.evaluate("[draft.width, [...draft.data].filter((_, i) => i % 4 === 0)]")
    levels = np.reshape(levels, (-1, width)).astype(float)
    assert levels.std(axis=0).min() > 10  # down each column
    assert levels.std(axis=1).max() < 3  # along each row


def test_the_board_takes_the_colours_of_a_system_that_turns_dark(page):
    page.locator("button.region").first.wait_for()
    # The grid below all regions, whose pictures may still come.
    corner = """(() => {
        const board = document.querySelector(".board canvas");
        const { width, height } = board;
        return board.getContext("2d").getImageData(0, height - 40, width, 30).data.join();
    })()"""
    light = page.evaluate(corner)
    page.emulate_media(color_scheme="dark")
    until(page, lambda: page.evaluate(corner) != light)
    page.emulate_media(color_scheme="light")
    until(page, lambda: page.evaluate(corner) == light)


@pytest.mark.slow  # it compiles; tests/clients has the numbers
def test_a_web_page_of_the_menu_is_felt_without_the_service(maker, page, browser, brick, tmp_path):
    page.get_by_label("Add a file").set_input_files(brick)
    page.get_by_role("heading", name="Parameters of brick").wait_for()
    page.get_by_text("Export", exact=True).click()
    with page.expect_download() as download:
        page.get_by_role("button", name="Web page").click()
    zipfile.ZipFile(download.value.path()).extractall(tmp_path / "site")
    with served_folder(tmp_path / "site") as site, a_page(browser) as felt:
        felt.goto(site)
        felt.locator("figure[data-state=ready]").wait_for()
        assert not violations(felt)
        box = felt.locator(".felt-pad").bounding_box()
        for step in range(60):
            at = 0.2 + 0.6 * abs(step % 30 - 15) / 15
            felt.mouse.move(box["x"] + at * box["width"], box["y"] + box["height"] / 2)
            felt.wait_for_timeout(10)
        # While it moves: a finger at rest feels nothing.
        shown = felt.locator("output").all_inner_texts()
        assert all(0.1 < float(mu) < 2.0 for mu in shown)


def test_an_exported_zip_opens_again_and_is_exported_byte_for_byte(maker, page, brick, tmp_path):
    page.get_by_label("Add a file").set_input_files(brick)
    page.get_by_role("heading", name="Parameters of brick").wait_for()

    def export():
        page.get_by_text("Export", exact=True).click()
        with page.expect_download() as download:
            page.get_by_role("button", name="Document").click()
        return download.value.path().read_bytes()

    first = export()
    path = tmp_path / "desk.zip"
    path.write_bytes(first)
    for asset in (maker.folder / "assets").iterdir():
        if brick.stat().st_size == asset.stat().st_size:
            asset.unlink()  # it comes with the archive
    choose(page, "New layout")
    until(page, lambda: not shown(page))
    page.get_by_label("Open an exported zip").set_input_files(path)
    page.locator("button.region").nth(4).wait_for()
    confirmed(page)
    assert export() == first
    path.write_bytes(first[: len(first) // 2])
    page.get_by_label("Open an exported zip").set_input_files(path)
    page.locator(".hint-of", has_text="expected a zip").wait_for()
    assert len(shown(page)) == 5
    page.expected_errors.clear()  # the file was away for a while


def test_the_fields_of_a_material_wait_for_no_picture(maker, browser, monkeypatch):
    async def refuses(pool, owner, do, **fields):
        raise Problem("limit", "expected at most 16 questions that wait")

    monkeypatch.setattr(PoolHere, "ask", refuses)
    with a_page(browser) as page:
        page.goto(address(maker))
        page.get_by_role("link", name="Make").click()
        region(page, "Ribs").click()
        page.locator(".panel input").first.wait_for()
        page.expected_errors.clear()  # the browser tells of the refused pictures


def test_the_fields_of_a_material_are_asked_for_again_by_a_button(maker, browser):
    """The page was opened while the service had no answer; nothing else asks again."""
    with a_page(browser) as page:
        page.route("**/v1/kinds", lambda route: route.fulfill(status=503, json=BUSY), times=1)
        page.goto(address(maker))
        page.get_by_role("link", name="Make").click()
        page.get_by_text(BUSY["sentence"]).wait_for()
        page.locator(".thumb").first.click()
        page.get_by_role("button", name="Try again").click()
        page.locator(".panel input").first.wait_for()
        page.expected_errors.clear()


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, SEQUENCES + 1))
def test_no_confirmed_edit_is_lost(maker, page, seed):
    """Random edits, undo, reloads, killed pages and second pages: what was said to be saved is.

    `HAPTIX_SEQUENCES=1000 make test-slow ARGS='-k no_confirmed_edit'` tries that many.
    """
    chance, pages = random.Random(seed), [page]
    first = shown(page)
    done = []
    seen = {page: first}
    steps = ["edit", "edit", "undo", "reload", "second", "kill", "keep", "service"]
    for _ in range(25):
        here, what = chance.choice(pages), chance.choice(steps)
        done.append((pages.index(here), what))
        if what == "edit":
            nudge(here, chance.choice(["ArrowRight", "ArrowDown", "Shift+ArrowLeft"]))
            seen[here] = confirmed(here)
        elif what == "undo":
            here.keyboard.press("Control+z")
            seen[here] = confirmed(here)
        elif what == "reload":
            opened(here).reload()
            before, seen[here] = seen[here], confirmed(opened(here))
            assert seen[here] in (before, *newest_kept(maker))  # another page may have kept it
        elif what == "second" and len(pages) < 3:
            pages.append(page.context.new_page())
            pages[-1].goto(page.url)
            seen[pages[-1]] = confirmed(opened(pages[-1]))
        elif what == "kill" and len(pages) > 1:
            pages.remove(here)
            here.close()
        elif what == "keep":
            here.keyboard.press("Control+s")
            here.locator(".hint-of", has_text=re.compile("kept as|meanwhile|already")).wait_for()
        elif what == "service":
            for session in list(maker.hub.sessions.values()):
                session.close(1001, "the service starts anew")
        for one in pages:
            until(one, lambda one=one, seen=seen: shown(one) == seen[one])
        there = [first, *on_service(maker)]
        assert all(labels in there for labels in seen.values()), done
        seen = {one: seen[one] for one in pages}
    page.expected_errors.clear()  # the browser tells of refused requests
