"""The engine as a package for pages: under Node against the library in C, and in Chromium."""

import functools
import http.server
import json
import shutil
import subprocess
import sys
import threading
from base64 import b64encode

import numpy as np
import pytest

import haptix
from haptix.feel.gallery import load
from haptix.feel.materials import Grating
from haptix.play import compile_touch
from tests.chromium import chromium
from tests.made_clients import ROOT, node_tools
from tests.play.render.engines import Engine
from tests.play.render.test_program import everything
from tests.waiting import PATIENCE_S, wait_for

PACKAGE = ROOT / "clients" / "engine"
MOST_BYTES = 150_000

PLAY = """
import { readFileSync } from "node:fs";
import { EngineCore } from "PACKAGE/src/core.js";
const { program, turns } = JSON.parse(readFileSync(0));
const engine = await EngineCore.load(new Uint8Array(Buffer.from(program, "base64")));
const played = turns.map(({ touches, points }) => {
  const taken = touches.map((touch) => engine.touch(touch));
  const { fingers, firstSample, wantedMu, feltMu, driveV, status } = engine.block(points);
  const rows = { wantedMu, feltMu, driveV, status };
  for (const name in rows) rows[name] = [...rows[name]];
  return { taken, fingers, firstSample, ...rows };
});
process.stdout.write(JSON.stringify(played));
"""

REFUSE = """
import { readFileSync } from "node:fs";
import { EngineCore } from "PACKAGE/src/core.js";
try {
  await EngineCore.load(new Uint8Array(readFileSync(0)));
} catch (error) {
  process.stdout.write(JSON.stringify([error.name, error.code, error.message]));
}
"""


@pytest.fixture(scope="module")
def surface(model):
    return haptix.FrictionSurface.build(model, {"normal_force_n": 0.5, "frequency_hz": 4000.0})


@pytest.fixture(scope="module")
def compiled(surface):
    with haptix.open_device("mock:") as device:
        yield lambda felt: compile_touch(surface, felt, device)


def under_node(script, given):
    if shutil.which("node") is None:
        pytest.skip("needs Node 20")
    done = subprocess.run(
        ["node", "--input-type=module", "-e", script.replace("PACKAGE", PACKAGE.as_uri())],
        input=given,
        capture_output=True,
        timeout=PATIENCE_S,
    )
    assert done.returncode == 0, done.stderr.decode()[-3000:]
    return json.loads(done.stdout)


def strokes(random, turns):
    """Touches of some fingers that come, turn, jump and go, between blocks of many lengths."""
    at_s, turn = 0.0, []
    down = {}
    for _ in range(turns):
        touches = []
        for finger in range(3):
            x, y, vx, vy = down.get(finger, (*random.uniform(0, 40, 2), *random.normal(0, 80, 2)))
            here = {
                "id": finger,
                "tS": at_s,
                "xMm": x,
                "yMm": y,
                "forceN": random.uniform(0.3, 0.7),
            }
            if finger in down and random.random() < 0.02:
                del down[finger]
                touches.append({**here, "isDown": False})
            elif random.random() < 0.8:
                touches.append(here)
                down[finger] = (x + 0.01 * vx, y + 0.01 * vy, *random.normal([vx, vy], 10))
        points = int(random.integers(1, 240))
        at_s += points / 12_000
        turn.append({"touches": touches, "points": points})
    return turn


@pytest.mark.parametrize("name", ["ribs", "everything", "islands"])
def test_node_plays_what_the_library_plays(compiled, name):
    felt = {"ribs": Grating(period_mm=2.0), "everything": everything()}.get(name)
    program = compiled(load("gallery:islands") if felt is None else felt)
    turns = strokes(np.random.default_rng(4), 120)
    given = {"program": b64encode(program).decode(), "turns": turns}
    played = under_node(PLAY, json.dumps(given).encode())
    engine = Engine(program)
    driven = 0
    for turn, got in zip(turns, played, strict=True):
        taken = [
            engine.touch(
                one["id"], one["tS"], one["xMm"], one["yMm"], one["forceN"], one.get("isDown", True)
            )
            == 1
            for one in turn["touches"]
        ]
        ours = engine.block(turn["points"])
        assert (got["taken"], got["fingers"], got["firstSample"]) == (
            taken, ours.fingers, ours.first_sample,
        )  # fmt: skip
        # The last bits of exp, log and sine are those of another library.
        np.testing.assert_allclose(got["wantedMu"], ours.wanted_mu, rtol=0, atol=1e-11)
        np.testing.assert_allclose(got["feltMu"], ours.felt_mu, rtol=0, atol=1e-11)
        np.testing.assert_allclose(got["driveV"], ours.drive_v, rtol=0, atol=1e-6)
        assert got["status"] == ours.status.tolist()
        driven += ours.fingers
    assert driven > 100


def test_a_program_that_is_refused_says_why(compiled):
    program = compiled(Grating(period_mm=2.0))
    for damaged, code, words in (
        (b"", -1, "is no program of a touch"),
        (program[:8] + b"\7" + program[9:], -2, "compile the layout again"),
        (program[:-1] + b"\1", -3, "checksum"),
    ):
        name, got, message = under_node(REFUSE, damaged)
        assert (name, got) == ("ProgramError", code)
        assert words in message


def test_the_package_is_small_and_whole():
    about = json.loads((PACKAGE / "package.json").read_text())
    files = [path for part in about["files"] for path in (PACKAGE / part).iterdir()]
    assert sum(path.stat().st_size for path in files) <= MOST_BYTES
    for entry in about["exports"].values():
        assert all((PACKAGE / path).is_file() for path in entry.values())
    for name in ("engine.wasm", "firmware.wasm"):
        assert (PACKAGE / "src" / name).read_bytes()[:4] == b"\0asm"


@pytest.mark.slow  # it compiles
def test_the_web_assembly_is_that_of_the_sources(tmp_path):
    pytest.importorskip("ziglang")
    script = ROOT / "scripts" / "make-engine.py"
    subprocess.run([sys.executable, script, "--check", tmp_path], check=True)
    for name in ("engine.wasm", "firmware.wasm"):
        made = (tmp_path / name).read_bytes()
        assert made == (PACKAGE / "src" / name).read_bytes(), f"run {script}"


USE = """
import { Engine, type Block } from "haptix-engine";
import { EngineCore } from "haptix-engine/core";
import { Driver } from "haptix-engine/driver";
import { openLink } from "haptix-engine/links";
import { PageDriver } from "haptix-engine/page-driver";
import { VirtualDriver } from "haptix-engine/virtual-driver";
const engine: Engine = await Engine.load("touch.hxp");
const stop: () => void = engine.attach(document.body, 45);
engine.addEventListener("block", ({ detail }) => console.log(detail.feltMu[0], detail.driveV));
const driver = new VirtualDriver(engine, document.createElement("canvas"));
driver.sounds = true;
driver.addEventListener("shown", ({ detail }) => console.log(detail.feltMu.toFixed(3)));
const felt: Float32Array = (await driver.curve()).feltMu;
const screen = await Driver.open(await openLink("hid", { again: true }), engine);
await screen.arm();
const ends: () => Promise<void> = screen.play(engine);
const played: PageDriver = await PageDriver.open("usb", engine, { ceilingV: 100 });
await played.arm();
const core = await EngineCore.load(new Uint8Array(9));
const block: Block = core.block(5);
stop();
console.log(block.fingers, engine.highestV, ends, felt);
"""


def test_its_types_are_those_of_its_use(tmp_path):
    tools = node_tools()
    folder = tmp_path / "node_modules" / "haptix-engine"
    shutil.copytree(PACKAGE, folder)
    (tmp_path / "package.json").write_text('{"type": "module"}')
    (tmp_path / "use.ts").write_text(USE)
    options = "--noEmit --strict --target es2022 --module nodenext --lib es2022,dom --skipLibCheck"
    done = subprocess.run(
        ["node", tools / "typescript" / "bin" / "tsc", *options.split(), "use.ts"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout


PAGE = """<!doctype html>
<title>A texture</title>
<style>#pad { width: 400px; height: 300px; background: #ccc } canvas { display: block }</style>
<div id="pad"></div>
<canvas id="curve" width="600" height="150"></canvas>
<script type="module">
  import { Engine } from "./src/engine.js";
  import { VirtualDriver } from "./src/virtual-driver.js";
  try {
    const engine = await Engine.load("touch.hxp");
    engine.attach(document.querySelector("#pad"), 40);
    window.blocks = [];
    if (!location.search)
      engine.addEventListener("block", ({ detail }) => blocks.push(detail));
    window.driver = new VirtualDriver(engine, document.querySelector("#curve"));
  } catch (error) {
    window.failure = String(error);
  }
  document.title = "ready";
</script>
"""


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


@pytest.fixture
def site(compiled, tmp_path):
    shutil.copytree(PACKAGE / "src", tmp_path / "src")
    (tmp_path / "index.html").write_text(PAGE)
    (tmp_path / "touch.hxp").write_bytes(compiled(Grating(period_mm=4.0)))
    server = http.server.ThreadingHTTPServer(
        ("127.0.0.1", 0), functools.partial(Quiet, directory=tmp_path)
    )
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_address[1]}/index.html", tmp_path
    server.shutdown()
    server.server_close()


def curve(page):
    rows = page.evaluate(
        "driver.curve().then((rows) => Object.values(rows).map((row) => [...row]))"
    )
    return np.array(rows, float)


def drawn(page):
    """Pixels of the curve that are not empty, of all."""
    return page.evaluate(
        "(() => { const shown = document.querySelector('#curve'), { width, height } = shown;"
        "const to = new OffscreenCanvas(width, height).getContext('2d');"
        "to.drawImage(shown, 0, 0);"
        "return to.getImageData(0, 0, width, height).data"
        ".filter((value, i) => i % 4 === 3 && value > 0).length })()"
    )


#: 400 ms in one turn of the page, with a mouse that moves. An engine of the page's own thread would
#: make up for 100 ms of it.
BUSY = """() => {
    const pad = document.querySelector("#pad"), began = blocks.at(-1).tS;
    const end = performance.now() + 400;
    for (let x = 20, next = 0; performance.now() < end;)
        if (performance.now() > next) {
            const at = { pointerType: "mouse", pointerId: 1, clientX: (x += 4), clientY: 150 };
            pad.dispatchEvent(new PointerEvent("pointermove", at));
            next = performance.now() + 8;
        }
    return began;
}"""


def plays_on(page):
    """Whether the engine plays while the page is busy; on a busy machine its worker may wait."""
    began = page.evaluate(BUSY)
    page.wait_for_timeout(50)
    return page.evaluate("blocks.at(-1).tS") > began + 0.3


def test_a_stroke_of_the_mouse_draws_what_is_felt(site):
    address, folder = site
    with chromium() as browser:
        page = browser.new_page()
        errors = []
        page.on("pageerror", lambda error: errors.append(error))
        page.goto(address)
        wait_for(lambda: page.title() == "ready")
        assert page.evaluate("window.failure") is None
        assert drawn(page) == 0
        page.mouse.click(500, 400)  # a browser asks for it before it sounds
        assert page.evaluate("(driver.sounds = true, driver.sounds)")
        assert page.locator("#curve").bounding_box()["width"] == 600
        for x in range(20, 380, 4):
            page.mouse.move(x, 150)
            page.wait_for_timeout(8)
        wait_for(lambda: np.isfinite(curve(page)[1]).sum() > 500)
        wanted, felt = curve(page)
        here = np.isfinite(felt)
        # The ribs go up and down over what can be reached, and what is felt follows.
        assert np.ptp(wanted[here]) > 0.03
        assert np.ptp(felt[here]) > 0.8 * np.ptp(wanted[here])
        assert drawn(page) > 500
        # A page that is busy does not stop the engine.
        wait_for(lambda: plays_on(page))
        page.mouse.move(500, 400)  # off the pad
        wait_for(lambda: page.evaluate("blocks.at(-1).fingers") == 0)
        volts = page.evaluate("Math.max(...blocks.at(-1).driveV.map(Math.abs))")
        assert volts == 0
        # A block after another, without a gap.
        gaps = page.evaluate(
            "blocks.slice(1).filter((b, i) => b.firstSample !== blocks[i].firstSample"
            " + blocks[i].driveV.length).length"
        )
        assert gaps == 0
        assert errors == []
        (folder / "touch.hxp").write_bytes(b"none")
        page.goto(address)
        wait_for(lambda: page.title() == "ready")
        assert "no program of a touch" in page.evaluate("window.failure")


#: What a page's thread does for a stroke: messages of workers that it takes.
COUNTED = """
window.messages = 0;
window.Worker = class extends Worker {
  constructor(...how) {
    super(...how);
    this.addEventListener("message", () => messages++);
  }
};
"""


def test_a_stroke_costs_the_page_no_message_a_block(site):
    """Only numbers for people; the worker draws the curve, in the colours of the page's CSS."""
    with chromium() as browser:
        page = browser.new_page()
        page.add_init_script(COUNTED)
        page.goto(site[0] + "?unheard")
        wait_for(lambda: page.title() == "ready")
        page.evaluate("document.body.style = '--felt: #00ff00'")
        page.evaluate("driver.addEventListener('shown', ({ detail }) => (window.last = detail))")
        page.evaluate("window.messages = 0")
        began = page.evaluate("performance.now()")
        for x in range(20, 380, 4):
            page.mouse.move(x, 150)
            page.wait_for_timeout(8)
        lasted_s = (page.evaluate("performance.now()") - began) / 1000
        assert 1 <= page.evaluate("messages") <= 10 * lasted_s
        assert 0.1 < page.evaluate("last.feltMu") < 2.0
        assert drawn(page) > 500
        assert page.evaluate(GREEN) > 100


GREEN = """(() => {
    const shown = document.querySelector("#curve"), { width, height } = shown;
    const to = new OffscreenCanvas(width, height).getContext("2d");
    to.drawImage(shown, 0, 0);
    const { data } = to.getImageData(0, 0, width, height);
    let count = 0;
    for (let i = 0; i < data.length; i += 4)
        if (data[i] === 0 && data[i + 1] === 255 && data[i + 2] === 0) count++;
    return count;
})()"""
