"""The studio in Chromium: start to the first felt stroke, frames, and pointer to plotted point.

    python benchmarks/studio.py [--seconds 20] [--fingers 2] [--visits 0] [--json]

It starts `haptix studio` with a mock driver and slides fingers over the board in headless Chromium
with software drawing, 1280 x 800, while the service renders on the same cores. With `--visits` it
opens Make on so many services that have just started, and reports the medians: until the gallery,
all fields and all pictures are there, and the service's processor time meanwhile.
"""

import argparse
import contextlib
import json
import math
import os
import re
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from playwright.sync_api import sync_playwright

WATCH = """
() => {
    const found = window.measured = {frames: [], plotted: [], handled: [], ahead: []};
    let before = null;
    const frame = (at) => {
        if (before !== null) found.frames.push(at - before);
        before = at;
        requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
    // An event comes before its frame's callbacks, in which the trail is drawn; the next frame
    // begins when that is on the screen.
    document.querySelector(".board").addEventListener("pointermove", (event) => {
        found.handled.push(performance.now() - event.timeStamp);
        const ahead = event.getPredictedEvents().at(-1);
        if (ahead) found.ahead.push(ahead.timeStamp - event.timeStamp);
        requestAnimationFrame(() => requestAnimationFrame(
            (shown) => found.plotted.push(shown - event.timeStamp)));
    });
}
"""


BARE = """<!doctype html><canvas class="board" width="800" height="500"
    style="width: 100vw; height: 100vh; touch-action: none"></canvas>"""
DRAW = """
() => {
    const canvas = document.querySelector(".board");
    const context = canvas.getContext("2d");
    canvas.addEventListener("pointermove", ({clientX, clientY}) => {
        requestAnimationFrame(() => context.fillRect(clientX / 2, clientY / 2, 4, 4));
    });
}
"""


def share(values, percent):
    """Percentile without numpy, which would start slower than the page."""
    return sorted(values)[min(int(len(values) * percent / 100), len(values) - 1)]


def ticks(pid):
    """Processor time of a process and all below it [s]."""
    total = 0
    for entry in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = entry.read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue
        if int(fields[2]) == pid:  # its group is called by it
            total += int(fields[11]) + int(fields[12])
    return total / os.sysconf("SC_CLK_TCK")


class Hand:
    """Fingers that slide over a page's board."""

    def __init__(self, context, page, fingers):
        self.box, self.fingers = page.locator(".board").bounding_box(), fingers
        self.touches = context.new_cdp_session(page)

    def slide(self, length_s, until=lambda: False):
        start_s = time.monotonic()
        self._send("touchStart", 0)
        while (t_s := time.monotonic() - start_s) < length_s and not until():
            self._send("touchMove", t_s)
            time.sleep(0.008)
        self.touches.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

    def _send(self, kind, t_s):
        box, last = self.box, max(self.fingers - 1, 1)
        points = [
            {
                "id": finger,
                "x": box["x"] + box["width"] * (0.5 + 0.4 * math.sin(1.3 * t_s + finger)),
                "y": box["y"] + box["height"] * (0.25 + 0.4 * finger / last),
            }
            for finger in range(self.fingers)
        ]
        self.touches.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})


@contextlib.contextmanager
def a_studio():
    """A studio that has just started, and its address."""
    environment = os.environ | {"HAPTIX_SERVICE": tempfile.mkdtemp()}
    command = [sys.executable, "-m", "haptix.tasks.cli", "studio", "--port", "0", "--no-open"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env=environment, start_new_session=True
    ) as service:
        yield service, re.search(r"http://\S+", service.stdout.readline())[0]
        service.send_signal(signal.SIGINT)
        service.communicate(timeout=20)


def a_browser(playwright):
    return playwright.chromium.launch(
        executable_path=shutil.which("chromium"),
        args=["--no-sandbox", "--disable-gpu", "--disable-background-networking"],
    )


def visit(browser):
    """Open Make for the first time; seconds until each is there, and of the processor."""
    came = {}

    def comes(answer):
        name = answer.url.rsplit("/", 1)[-1]
        if answer.ok and name in ("gallery", "kinds", "pictures"):
            came.setdefault(name, []).append(time.monotonic())

    with a_studio() as (service, address):
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.on("response", comes)
        began_s, before_s = time.monotonic(), ticks(service.pid)
        page.goto(address)
        page.get_by_role("link", name="Make").click()
        while {name: min(len(times), 4) for name, times in came.items()} != {
            "gallery": 1, "kinds": 1, "pictures": 4,  # one for each region
        }:  # fmt: skip
            page.wait_for_timeout(20)
        busy_s = ticks(service.pid) - before_s
        page.close()
    return {f"{name}_after_s": times[-1] - began_s for name, times in sorted(came.items())} | {
        "processor_s": busy_s
    }


def measure_visits(count):
    with sync_playwright() as playwright:
        browser = a_browser(playwright)
        visits = [visit(browser) for _ in range(count)]
        browser.close()
    medians = {name: round(statistics.median(one[name] for one in visits), 2) for name in visits[0]}
    return medians | {"load_of_the_machine": os.getloadavg()[0]}


def measure(seconds, fingers):
    began_s = time.monotonic()
    with a_studio() as (service, address), sync_playwright() as playwright:
        served_s = time.monotonic() - began_s
        browser = a_browser(playwright)
        context = browser.new_context(viewport={"width": 1280, "height": 800}, has_touch=True)
        page = context.new_page()
        opened_s = time.monotonic()
        page.goto(address)
        page.locator('.output[data-state="armed"]').wait_for()
        armed_s = served_s + time.monotonic() - opened_s
        weight = page.evaluate(
            "performance.getEntriesByType('resource').reduce((sum, e) => sum + e.transferSize, 0)"
        )
        hand = Hand(context, page, fingers)
        felt = page.locator('[data-name="felt"] dd')
        hand.slide(20, lambda: felt.inner_text() not in ("–", "NaN"))
        first_s = served_s + time.monotonic() - opened_s
        page.evaluate(WATCH)
        before_s = ticks(service.pid)
        hand.slide(seconds)
        busy = (ticks(service.pid) - before_s) / seconds
        found = page.evaluate("measured")
        # What the browser itself takes here: a page that only draws points, in the same run.
        page.close()
        bare_page = context.new_page()
        bare_page.set_content(BARE)
        bare_page.evaluate(DRAW)
        bare_page.evaluate(WATCH)
        Hand(context, bare_page, fingers).slide(seconds / 2)
        bare = bare_page.evaluate("measured")
        browser.close()
    frames, plotted = found["frames"], found["plotted"]
    return {
        "serves_after_s": round(served_s, 2),
        "armed_after_s": round(armed_s, 2),
        "first_felt_stroke_s": round(first_s, 2),
        "page_kb": round(weight / 1000, 1),
        "frames": len(frames),
        "frame_p50_ms": round(share(frames, 50), 2),
        "frame_p95_ms": round(share(frames, 95), 2),
        "frames_below_20_ms": round(sum(one < 20 for one in frames) / len(frames), 4),
        "event_p50_ms": round(share(found["handled"], 50), 2),  # the browser's own part
        "plotted_p50_ms": round(share(plotted, 50), 2),
        "plotted_p95_ms": round(share(plotted, 95), 2),
        "predicted_ahead_p50_ms": round(share(found["ahead"] or [0.0], 50), 2),
        "bare_event_p50_ms": round(share(bare["handled"], 50), 2),
        "bare_plotted_p50_ms": round(share(bare["plotted"], 50), 2),
        "plotted_over_bare": round(share(plotted, 50) / share(bare["plotted"], 50), 2),
        "service_cores": round(busy, 3),
        "load_of_the_machine": os.getloadavg()[0],
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--fingers", type=int, default=2)
    parser.add_argument("--visits", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    if options.visits:
        found = measure_visits(options.visits)
    else:
        found = measure(options.seconds, options.fingers)
    if options.json:
        print(json.dumps(found))
    else:
        for name, value in found.items():
            print(f"{name:24} {value}")


if __name__ == "__main__":
    main()
