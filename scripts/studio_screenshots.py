"""Make the pictures of the studio in the docs; run it on a machine that does nothing else.

    python scripts/studio_screenshots.py [docs]

It starts `haptix studio` with a mock driver, slides by keys, and keeps what the pages show.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

WIDE_PX, HIGH_PX = 1280, 800
PLAY_HIGH_PX = 900  # so high is Play with all its plots
STRIP_PX = 560
IS_DRAWN = """() => {
    const canvas = document.querySelector(".board canvas");
    const { data } = canvas.getContext("2d").getImageData(
        canvas.width * 0.1, canvas.height * 0.3, canvas.width * 0.2, 1);
    const greens = [...data].filter((_, at) => at % 4 === 1);
    return Math.max(...greens) - Math.min(...greens) > 150;
}"""


def slide(page, keys, seconds):
    """Hold arrow keys: the page times them itself."""
    for key in keys:
        page.keyboard.down(key)
    page.wait_for_timeout(1000 * seconds)
    for key in keys:
        page.keyboard.up(key)


def main():
    """Make them all."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "docs")
    environment = os.environ | {"HAPTIX_SERVICE": tempfile.mkdtemp()}
    command = [sys.executable, "-m", "haptix.tasks.cli", "studio", "--port", "0", "--no-open"]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as service,
        sync_playwright() as playwright,
    ):
        try:
            address = re.search(r"http://\S+", service.stdout.readline())[0]
            browser = playwright.chromium.launch(
                executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
            )
            context = browser.new_context(viewport={"width": WIDE_PX, "height": HIGH_PX})
            page = context.new_page()
            page.set_default_timeout(120_000)  # of a busy machine
            page.goto(address)
            page.locator('.output[data-state="armed"]').wait_for()
            play(page, folder)
            make(page, folder)
            screens(page, folder)
            strip(folder)
            calibrate(page, folder)
            sit(page, folder)
            small(page, folder)
            lost(page, folder, service)
            browser.close()
        finally:  # also when a page did not come: the service does not end by itself
            service.send_signal(signal.SIGINT)
            service.communicate(timeout=60)


def play(page, folder):
    """The board with a felt stroke."""
    page.set_viewport_size({"width": WIDE_PX, "height": PLAY_HIGH_PX})
    with page.expect_response("**/v1/pictures"):
        page.reload()  # the maker is warm by now
    page.locator('.output[data-state="armed"]').wait_for()
    page.wait_for_function(IS_DRAWN)
    page.wait_for_load_state("networkidle")
    page.locator(".board").focus()
    is_felt = False
    while not is_felt:  # the virtual finger makes its tables first
        for key in ("ArrowRight", "ArrowLeft"):
            page.keyboard.down(key)
            page.wait_for_timeout(600)
            is_felt = page.locator('[data-name="felt"] dd').inner_text() not in ("–", "NaN")
            if is_felt:
                _shot(page, folder / "studio-play.png")
            page.keyboard.up(key)
    page.set_viewport_size({"width": WIDE_PX, "height": HIGH_PX})


def strip(folder):
    """Three pages side by side, in small."""
    height = STRIP_PX * HIGH_PX // WIDE_PX
    whole = Image.new("RGB", (3 * STRIP_PX, height))
    for number, name in enumerate(("make", "play", "screens")):
        frame = Image.open(folder / f"studio-{name}.png").crop((0, 0, WIDE_PX, HIGH_PX))
        small_one = frame.resize((STRIP_PX, height), Image.Resampling.LANCZOS)
        whole.paste(small_one, (number * STRIP_PX, 0))
    whole.save(folder / "studio-strip.png", optimize=True)


def make(page, folder):
    """The gallery, the board and the parameters of a region."""
    page.get_by_role("link", name="Make").click()
    page.locator(".thumb").first.wait_for()
    page.locator("button.region").first.click()
    page.get_by_text("just-noticeable differences").wait_for()
    page.wait_for_timeout(2000)  # for the regions' pictures
    _shot(page, folder / "studio-make.png")


def screens(page, folder):
    """What plays, in volts, beside a page that touches."""
    page.get_by_role("link", name="Play").click()
    page.locator(".board").focus()
    looks = page.context.new_page()
    looks.goto(f"{page.url.split('#')[0]}#/screens")
    looks.get_by_text("roughness: a placeholder").wait_for()
    for _ in range(60):
        for key in ("ArrowLeft", "ArrowRight"):
            page.keyboard.down(key)
            page.wait_for_timeout(600)
            page.keyboard.up(key)
        if looks.get_by_text("µA", exact=False).count():
            break
    _shot(looks, folder / "studio-screens.png")
    looks.close()


def calibrate(page, folder):
    """A practice that asks for its first stroke."""
    page.get_by_role("link", name="Calibrate").click()
    page.get_by_role("button", name="Begin").click()
    go = page.get_by_role("button", name="Go", exact=True)
    go.wait_for()
    go.click()
    page.get_by_text("Stroke 2 of").wait_for()
    page.locator(".calibrate .uplot").last.wait_for()
    _shot(page, folder / "studio-calibrate.png")
    page.get_by_role("button", name="Stop for now").click()
    page.get_by_text("still open").wait_for()


def sit(page, folder):
    """The first trial of a practice."""
    page.get_by_role("link", name="Sit").click()
    page.get_by_role("button", name="Begin").click()
    page.get_by_text("Rest a fingertip").wait_for()
    page.keyboard.press("Space")
    page.get_by_role("button", name="the first").wait_for()
    _shot(page, folder / "studio-sit.png")
    page.keyboard.press("F8")
    page.get_by_text("the experiment was ended").wait_for()


def small(page, folder):
    """A telephone's width, dark."""
    page.set_viewport_size({"width": 360, "height": 800})
    page.emulate_media(color_scheme="dark")
    page.goto(page.url.split("#")[0])
    page.locator('.output[data-state="armed"]').wait_for()
    page.wait_for_function(IS_DRAWN)
    page.locator(".board").focus()
    slide(page, ["ArrowLeft"], 0.9)
    page.wait_for_timeout(500)
    page.evaluate("scrollTo(0, 0)")
    _shot(page, folder / "studio-360.png", full_page=True)


def lost(page, folder, service):
    """What the page says once its service is gone."""
    page.set_viewport_size({"width": WIDE_PX, "height": HIGH_PX})
    page.goto(f"{page.url.split('#')[0]}#/screens")
    page.get_by_text("roughness: a placeholder").wait_for()
    service.kill()
    page.get_by_text("start it again in its terminal").wait_for()
    _shot(page, folder / "studio-lost.png")


def _shot(page, path, **options):
    # Of a busy machine, not of the page.
    page.evaluate("document.querySelectorAll('.notice').forEach((one) => one.remove())")
    page.screenshot(path=path, **options)
    Image.open(path).convert("RGB").save(path, optimize=True)
    return path


if __name__ == "__main__":
    main()
