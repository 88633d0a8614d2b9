"""Figures of a page that plays a program of a touch: in Chromium, and its engine beside the native.

    .venv/bin/python benchmarks/page.py

The exported page of a photograph, with Debian's Chromium. A stroke's reports come every 8 ms from
the page itself. The processor's share is of the page's process: worker, page and what it draws.
The latency is from the report that lifts a finger, at a time of chance, to the block that lacks it
in the page. The engines play the same strokes in turns; the fastest turn of each counts.
"""

from __future__ import annotations

import functools
import http.server
import json
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

STROKES = """async ([fingers, seconds]) => {
    const at = performance.now(), end = at + 1000 * seconds;
    await new Promise((done) => {
        const timer = setInterval(() => {
            const now = performance.now(), s = (now - at) / 1000;
            for (let id = 1; id <= fingers; id++)
                engine.touch(id, 20 + 15 * Math.sin(5 * s + id), 8 * id, { isDown: now < end });
            if (now > end) done(clearInterval(timer));
        }, 8);
    });
}"""
LIFTS = """async (count) => {
    const found = [], sleep = (ms) => new Promise((done) => setTimeout(done, ms));
    for (let k = 0; k < count; k++) {
        let x = 10;
        for (let step = 0; step < 12; step++) { engine.touch(1, (x += 1), 9); await sleep(8); }
        await sleep(5 * Math.random());
        const began = performance.now();
        const block = new Promise((done) => {
            const hear = ({ detail }) => {
                if (detail.fingers) return;
                engine.removeEventListener("block", hear);
                done(performance.now() - began);
            };
            engine.addEventListener("block", hear);
        });
        engine.touch(1, x, 9, { isDown: false });
        found.push(await block);
        await sleep(20);
    }
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


def page_figures(folder: Path) -> dict[str, float]:
    """Processor's share for two fingers, and latency, of the page in a folder."""
    script = folder / "felt.js"
    text = script.read_text("utf-8")
    script.write_text(text.replace("engine.attach", "window.engine = engine;\n  engine.attach"))
    handler = functools.partial(_Quiet, directory=folder)
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    with chromium() as browser:
        page = browser.new_page()
        page.goto(f"http://127.0.0.1:{server.server_address[1]}/")
        page.wait_for_function("document.querySelector('figure').dataset.state === 'ready'")
        session = browser.new_browser_cdp_session()

        def used_s() -> float:
            processes = session.send("SystemInfo.getProcessInfo")["processInfo"]
            return sum(one["cpuTime"] for one in processes if one["type"] == "renderer")

        def share() -> float:
            page.evaluate(STROKES, [2, 1])  # its code is compiled
            began_s, before_s = time.perf_counter(), used_s()
            page.evaluate(STROKES, [2, SECONDS])
            return round((used_s() - before_s) / (time.perf_counter() - began_s), 3)

        shown = share()
        lifts_ms = page.evaluate(LIFTS, 100)
        page.goto(f"http://127.0.0.1:{server.server_address[1]}/felt.css")  # nothing to draw
        page.evaluate(
            "import('/engine.js').then(async ({ Engine }) => {"
            " window.engine = await Engine.load('/touch.hxp'); })"
        )
        alone = share()
    server.shutdown()
    server.server_close()
    return {
        "two_fingers_share_of_a_core": shown,
        "two_fingers_share_without_curve_and_numbers": alone,
        "to_virtual_driver_p50_ms": round(float(np.median(lifts_ms)), 2),
        "to_virtual_driver_p95_ms": round(float(np.quantile(lifts_ms, 0.95)), 2),
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
