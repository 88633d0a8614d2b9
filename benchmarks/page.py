"""Figures of a page that plays a program of a touch: in Chromium, and its engine beside the native.

    .venv/bin/python benchmarks/page.py

The exported page of a photograph, with Debian's Chromium, which draws by the processor here: the
picture, the curve of 1.5 s at 15 pictures a second, and the numbers. Two fingers are touches of the
browser, as fast as it takes them, at most 125 a second. The processor's share is of the page's
process: its thread, the worker with engine and curve, and Chromium's own threads for input and
pictures. What the same touches cost in a page that hears none of them, and the process that shows
the pictures, are rows of their own.

The latency is from the report of a finger that goes aside, at a time of chance, to the first block
that has it: in the virtual driver, that is in the worker, and in the page, if that takes the
blocks. The engines play the same strokes in turns; the fastest turn of each counts.
"""

from __future__ import annotations

import functools
import http.server
import json
import math
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from haptix.base.native import ffi, library
from haptix.feel.gallery import load
from haptix.play.touch_page import page_files
from haptix.tasks.programs import compiled

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))
from tests.chromium import chromium  # noqa: E402  # beside the product

PACKAGE = ROOT / "clients" / "engine"
LAYOUT = "brick"
POINTS, BLOCKS, TURNS = 60, 2000, 7
SECONDS = 10

#: Stamps blocks in which the first finger goes aside, in the worker.
STAMP = """  take(block) {
    const y = block.yMm[block.points - 1];
    if (Math.abs(y - this.y) > 0.05)
      new BroadcastChannel("aside").postMessage(performance.timeOrigin + performance.now());
    this.y = y;
"""
STEPS = """async ([count, inPage]) => {
    const found = [], sleep = (ms) => new Promise((done) => setTimeout(done, ms));
    const driver = new BroadcastChannel("aside");
    let [before, hear] = [NaN, null];
    if (inPage)
        engine.addEventListener("block", ({ detail: { yMm, points } }) => {
            const y = yMm[points - 1];
            if (Math.abs(y - before) > 0.05) hear?.(performance.timeOrigin + performance.now());
            before = y;
        });
    else driver.onmessage = ({ data }) => hear?.(data);
    for (let k = 0; k < count; k++) {
        let [x, y] = [10, 9 + 6 * (k % 2)];
        for (let step = 0; step < 20; step++) { engine.touch(1, (x += 1), y); await sleep(8); }
        await sleep(5 * Math.random());
        const began = performance.timeOrigin + performance.now();
        const aside = new Promise((done, fail) => {
            hear = done;
            setTimeout(fail, 1000, new Error("no block has the report"));
        });
        engine.touch(1, x + 1, 24 - y);
        found.push((await aside) - began);
        hear = null;
    }
    engine.touch(1, 10, 9, { isDown: false });
    return found;
}"""
WASM = """
import { readFileSync } from "node:fs";
const [wasm, program, points, blocks] = process.argv.slice(1);
const bytes = new Uint8Array(readFileSync(program));
const { exports } = new WebAssembly.Instance(new WebAssembly.Module(readFileSync(wasm)));
const place = exports.space(bytes.length) >>> 0; // may grow the memory
new Uint8Array(exports.memory.buffer, place, bytes.length).set(bytes);
if (exports.open(bytes.length) !== 0) throw new Error("refused");
let [best, tS] = [Infinity, 0];
for (let turn = 0; turn < 5; turn++) {
  const began = process.hrtime.bigint();
  for (let k = 0; k < blocks; k++, tS += points / 12000) {
    exports.touch(1, tS, 20 + 15 * Math.sin(5 * tS), 9, 0, 1);
    exports.block(Number(points));
  }
  best = Math.min(best, Number(process.hrtime.bigint() - began) / blocks / 1e3);
}
console.log(best);
"""


def native_us(program: bytes) -> float:
    """Time of one block of the library in C, with its report."""
    memory = ffi.new("double[]", library.hx_engine_size(program, len(program)) // 8 + 1)
    engine = library.hx_engine_open(program, len(program), memory)
    t_s = np.arange(5 * BLOCKS) * POINTS / 12_000
    places = (20 + 15 * np.sin(5 * t_s)).tolist()
    best, number = np.inf, 0
    for _ in range(5):
        began_s = time.perf_counter()
        for _ in range(BLOCKS):
            library.hx_engine_touch(engine, 1, t_s[number], places[number], 9.0, 0.0, True)
            library.hx_engine_block(engine, POINTS)
            number += 1
        best = min(best, (time.perf_counter() - began_s) / BLOCKS * 1e6)
    return best


def wasm_us(program: Path) -> float:
    """Time of one block of the WebAssembly under Node, with its report."""
    wasm = PACKAGE / "src" / "engine.wasm"
    command = ["node", "--input-type=module", "-e", WASM, wasm, program, str(POINTS), str(BLOCKS)]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: Any) -> None:
        pass


def stroke(page: Any, seconds: float) -> None:
    """Two fingers over the picture, as the browser's input."""
    session = page.context.new_cdp_session(page)
    box = page.locator(".felt-pad").bounding_box()
    began_s, kind = time.perf_counter(), "touchStart"
    while (at_s := time.perf_counter() - began_s) < seconds:
        points = [
            {
                "id": finger,
                "x": box["x"] + box["width"] * (0.5 + 0.35 * math.sin(5 * at_s + finger)),
                "y": box["y"] + box["height"] * (0.2 + 0.3 * finger),
            }
            for finger in range(2)
        ]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
        kind = "touchMove"
        time.sleep(max(0.008 - (time.perf_counter() - began_s - at_s), 0.0))
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    session.detach()


def page_figures(folder: Path) -> dict[str, float]:
    """Processor's share for two fingers, and latency, of the page in a folder."""
    for name, old, new in (
        ("felt.js", "engine.attach", "window.engine = engine;\n  engine.attach"),
        ("curve.js", "  take(block) {\n", STAMP),
    ):
        text = (folder / name).read_text("utf-8")
        if old not in text:
            raise ValueError(f"{name}: expected {old!r}")
        (folder / name).write_text(text.replace(old, new))
    handler = functools.partial(_Quiet, directory=folder)
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    address = f"http://127.0.0.1:{server.server_address[1]}/"
    with chromium() as browser:
        page = browser.new_page()
        session = browser.new_browser_cdp_session()

        def used_s() -> np.ndarray:
            processes = session.send("SystemInfo.getProcessInfo")["processInfo"]
            return np.array(
                [
                    sum(p["cpuTime"] for p in processes if p["type"] == t)
                    for t in ("renderer", "GPU")
                ]
            )

        def share() -> tuple[float, float]:
            stroke(page, 1)  # its code is compiled
            began_s, before_s = time.perf_counter(), used_s()
            stroke(page, SECONDS)
            shares = (used_s() - before_s) / (time.perf_counter() - began_s)
            return round(float(shares[0]), 3), round(float(shares[1]), 3)

        def opened() -> None:
            page.goto(address)
            page.wait_for_selector("figure[data-state=ready]")

        opened()
        shown, pictures = share()
        to_driver_ms = page.evaluate(STEPS, [100, False])
        to_page_ms = page.evaluate(STEPS, [100, True])
        opened()
        page.evaluate("document.querySelector('.felt-side').remove()")
        alone, _ = share()
        opened()
        page.evaluate(
            "(pad => pad.replaceWith(pad.cloneNode(true)))(document.querySelector('.felt-pad'))"
        )
        deaf, _ = share()
    server.shutdown()
    server.server_close()
    return {
        "two_fingers_share_of_a_core": shown,
        "process_that_shows_pictures": pictures,
        "two_fingers_without_curve_and_numbers": alone,
        "touches_that_the_page_does_not_hear": deaf,
        "to_virtual_driver_p50_ms": round(float(np.median(to_driver_ms)), 2),
        "to_virtual_driver_p95_ms": round(float(np.quantile(to_driver_ms, 0.95)), 2),
        "to_page_p50_ms": round(float(np.median(to_page_ms)), 2),
        "to_page_p95_ms": round(float(np.quantile(to_page_ms, 0.95)), 2),
    }


def main() -> None:
    """Print the figures."""
    felt = load(Path(f"gallery:{LAYOUT}"))
    program = compiled(felt, None, None)
    files = [path for part in ("src", "types") for path in (PACKAGE / part).iterdir()]
    figures: dict[str, float] = {"package_bytes": sum(path.stat().st_size for path in files)}
    folder = Path(tempfile.mkdtemp())
    try:
        for name, content in page_files(program, felt, LAYOUT).items():
            (folder / name).write_bytes(content)
        turns = [(native_us(program), wasm_us(folder / "touch.hxp")) for _ in range(TURNS)]
        native, wasm = (min(times) for times in zip(*turns, strict=True))
        figures |= {"native_us_of_5_ms": round(native, 2), "wasm_us_of_5_ms": round(wasm, 2)}
        figures["wasm_beside_native"] = round(wasm / native, 2)
        figures |= page_figures(folder)
    finally:
        shutil.rmtree(folder)
    sys.stdout.write(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
