"""Make the pictures of docs/studio.md and the README; run it on a machine that does nothing else.

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
    command = [sys.executable, "-m", "haptix.cli", "studio", "--port", "0", "--no-open"]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as service,
        sync_playwright() as playwright,
    ):
        address = re.search(r"http://\S+", service.stdout.readline())[0]
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
        )
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(address)
        page.locator('.output[data-state="armed"]').wait_for(timeout=60_000)
        page.wait_for_function(IS_DRAWN, timeout=60_000)
        board = page.locator(".board")
        board.focus()
        felt = page.locator('[data-name="felt"] dd')
        is_felt = False  # the virtual finger makes its tables first
        while not is_felt:
            for key in ("ArrowLeft", "ArrowRight"):
                page.keyboard.down(key)
                page.wait_for_timeout(700)
                is_felt = is_felt or felt.inner_text() != "–"
                page.keyboard.up(key)
        frames = []
        for keys in (["ArrowLeft"], ["ArrowUp", "ArrowRight"], ["ArrowRight"]):
            for key in keys:
                page.keyboard.down(key)
            page.wait_for_timeout(800)
            frames.append(Image.open(_shot(page, folder / "studio-play.png")).convert("RGB"))
            for key in keys:
                page.keyboard.up(key)
        height = STRIP_PX * 800 // 1280
        strip = Image.new("RGB", (3 * STRIP_PX, height))
        for number, frame in enumerate(frames):
            small = frame.resize((STRIP_PX, height), Image.Resampling.LANCZOS)
            strip.paste(small, (number * STRIP_PX, 0))
        strip.save(folder / "studio-strip.png", optimize=True)
        page.get_by_role("link", name="Screens").click()
        page.get_by_text("roughness: a placeholder").wait_for()
        _shot(page, folder / "studio-screens.png")
        page.set_viewport_size({"width": 360, "height": 800})
        page.emulate_media(color_scheme="dark")
        page.get_by_role("link", name="Play").click()
        page.wait_for_function(IS_DRAWN, timeout=60_000)
        board.focus()
        slide(page, ["ArrowLeft"], 0.9)
        page.wait_for_timeout(500)
        page.evaluate("scrollTo(0, 0)")
        _shot(page, folder / "studio-360.png", full_page=True)
        browser.close()
        service.send_signal(signal.SIGINT)
        service.communicate(timeout=20)


def _shot(page, path, **options):
    page.screenshot(path=path, **options)
    Image.open(path).convert("RGB").save(path, optimize=True)
    return path


if __name__ == "__main__":
    main()
