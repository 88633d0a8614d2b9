"""What materials cost and how well they are felt, against an earlier state of haptix.

    git worktree add --detach ../earlier COMMIT
    .venv/bin/python benchmarks/materials.py --base ../earlier

Blocks are of 1 ms. Times are those of the processor, in batches that alternate between processes,
so that what else the machine does meets all alike: the median batch, and the median ratio of two
batches that follow each other. Then: the share of a core that ten moving sprites take in real
time, relief and detents as the virtual finger feels them, and a photograph of 2 megapixels.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parents[1]
BLOCKS, BATCHES, POINTS, STEP_S, RATE = 200, 60, 12, 1 / 12_000, 48_000
NAMES = ["photograph", "sprites", "side by side", "relief", "slider"]


def surface_of(ranges: dict[str, Any]) -> tuple[Any, Any]:
    import torch

    import haptix

    torch.set_num_threads(1)
    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    return model, haptix.FrictionSurface.build(model, ranges, tolerance=5e-4)


def texture_of(name: str, photograph: Any) -> Any:
    """What is felt, by name; an earlier haptix knows the photograph alone."""
    import haptix

    if name == "photograph":
        return photograph
    if name == "sprites":
        return sprites(photograph, 0.3)
    if name == "side by side":
        return sprites(photograph, 37.0)
    return haptix.feel.materials.load(HERE / f"examples/materials/{name}.toml")


def sprites(photograph: Any, step_mm: float) -> Any:
    """Ten regions of one photograph."""
    import haptix

    layout = haptix.Layout()
    for k in range(10):
        layout.add(photograph, 5 + step_mm * k % 150, 5 + 0.2 * k, 30, 20)
    return layout


def block_of(surface: Any, texture: Any) -> Callable[[], None]:
    """One finger at 50 mm/s: prediction, texture, surface, fades, wave; regions move meanwhile."""
    import haptix
    from haptix.play.render import LiveSettings, RenderCore, RenderSettings, SineCarrier
    from haptix.play.render.fingers import PredictedFingers
    from haptix.play.touch import TouchEvent, TouchSettings

    touches = PredictedFingers(LiveSettings(touch=TouchSettings(lost_after_s=60.0)))
    for i in range(30):
        touches.take(TouchEvent(0.01 * i, 0, 10 + 0.5 * i, 20.0, "move", 0.5 + 0.005 * i))
    touches.update(0.29)
    settings = RenderSettings(block_s=1e-3)
    core = RenderCore(surface, texture, haptix.open_device("mock:"), SineCarrier(4000.0), settings)
    if hasattr(texture, "patches"):
        texture.attach(lambda: 0.0)
        for i, patch in enumerate(texture.patches.values()):
            patch.move(x_mm=patch.x_mm + 1 + i % 3, over_s=3600.0)
    state: dict[str, Any] = {"sample": 0, "amplitude_v": 0.0}

    def one() -> None:
        first = state["sample"]
        motion = touches.motion(0.3 + 1e-7 * first, STEP_S, POINTS, 0.01 + first / RATE)
        block = core.block(motion, first, state["amplitude_v"])
        state["sample"], state["amplitude_v"] = first + 48, float(block.amplitude_v[-1])

    return one


def work(names: list[str]) -> None:
    """Answer each line, the name of a texture, by the processor time of a block [us]."""
    import haptix

    _, surface = surface_of({"normal_force_n": (0.1, 1.0), "frequency_hz": 4000.0})
    surface = surface.at(4000.0)
    pixels = np.random.default_rng(0).random((1000, 2000))
    photograph = haptix.Texture.from_image(pixels, width_mm=60)
    blocks = {name: block_of(surface, texture_of(name, photograph)) for name in names}
    print("ready", flush=True)
    for line in sys.stdin:
        one = blocks[line.strip()]
        for _ in range(10):
            one()
        began = time.thread_time()
        for _ in range(BLOCKS):
            one()
        print((time.thread_time() - began) / BLOCKS * 1e6, flush=True)


class Worker:
    """A process that renders blocks with one state of haptix."""

    def __init__(self, tree: Path, names: list[str]) -> None:
        self.process = subprocess.Popen(
            [sys.executable, __file__, "--work", *names],
            env={**os.environ, "PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1"},
            cwd=tree, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        self._line()

    def _line(self) -> str:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            sys.exit(f"a worker has ended with {self.process.wait()}")
        return line

    def us(self, name: str) -> float:
        assert self.process.stdin is not None
        print(name, file=self.process.stdin, flush=True)
        return float(self._line())

    def end(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait()


def blocks(base: Path | None, batches: int) -> dict[str, Any]:
    here = Worker(HERE, NAMES)
    earlier = here if base is None else Worker(base.resolve(), NAMES[:1])
    found: dict[str, Any] = {}
    for name in NAMES:
        rows = np.array([(earlier.us("photograph"), here.us(name)) for _ in range(batches)])
        ratio = float(np.median(rows[:, 1] / rows[:, 0]))
        found[name] = {"us": float(np.median(rows[:, 1])), "ratio": ratio}
        print(f"  {name:14} {found[name]['us']:6.1f} us   {ratio:5.2f} times", flush=True)
    here.end()
    if base is not None:
        earlier.end()
    return found


def photograph() -> dict[str, Any]:
    import haptix

    pixels = np.random.default_rng(0).integers(0, 255, (1000, 2000), dtype=np.uint8)
    found: dict[str, Any] = {}
    for what in ("with what a process imports", "enters"):
        began = time.perf_counter(), time.process_time()
        layout = haptix.Layout()
        patch = layout.add(haptix.Texture.from_image(pixels, width_mm=60))
        entered = time.perf_counter() - began[0], time.process_time() - began[1]
        print(f"  {what}: {entered[0]:.2f} s ({entered[1]:.2f} s of the processor)")
        found[what] = {"s": entered[0], "processor_s": entered[1]}
    layout.attach(lambda: 10.0)
    for regions in (1, 10, 100):
        while len(layout.patches) < regions:
            layout.add(patch.material, 2.0 * len(layout.patches), 0, 30, 20)
        used = time.thread_time()
        for i in range(2000):
            patch.move(x_mm=i * 0.01)
        found[f"move_us_{regions}"] = (time.thread_time() - used) / 2000 * 1e6
        print(f"  a move among {regions} regions: {found[f'move_us_{regions}']:.0f} us")
    return found


def in_real_time(seconds: float) -> dict[str, Any]:
    """Ten moving sprites on a mock in real time, all moved by the app 60 times a second."""
    import haptix

    _, surface = surface_of({"normal_force_n": 0.5, "frequency_hz": 4000})
    pixels = np.random.default_rng(0).random((1000, 2000))
    layout = sprites(haptix.Texture.from_image(pixels, width_mm=60), 0.3)
    device = haptix.open_device("mock:pace=real")
    patches = list(layout.patches.values())
    with haptix.LiveRenderer(surface, layout, device) as renderer:
        began, used = time.monotonic(), time.process_time()
        for i in range(int(60 * seconds)):
            t = i / 60
            time.sleep(max(0.0, began + t - time.monotonic()))
            with layout.change():
                for k, patch in enumerate(patches):
                    patch.move(x_mm=5 + 3 * np.sin(t + k).item())
            renderer.touch(renderer.now_s(), 20 + 10 * np.sin(9 * t).item(), 15.0)
        spent = time.monotonic() - began
        share = (time.process_time() - used) / spent
    device.close()
    stats = renderer.stats
    print(f"  {share:.1%} of a core, {stats.underruns} underruns; mock driver and app included")
    return {"core_share": share, "underruns": stats.underruns, "seconds": spent}


def felt() -> dict[str, Any]:
    """Relief both ways and detents at 100 mm/s, under the virtual finger, recorded touches."""
    import haptix
    from haptix.play.simulation import Setting, simulate
    from haptix.play.virtual_finger import TouchPanel

    model, surface = surface_of({"normal_force_n": (0.3, 0.8), "frequency_hz": 4000.0})
    t = np.arange(0, 0.9, 0.005)
    x = np.interp(t, [0, 0.35, 0.45, 0.8, 0.9], [2, 37, 37, 2, 2])
    path = haptix.Trajectory(t, x, np.full_like(t, 17.0), np.full_like(t, 0.5))
    found = {}
    for name in ("relief", "slider"):
        setting = Setting(model, texture_of(name, None), path)
        recorded, live = simulate(setting, surface), simulate(setting, surface, TouchPanel())
        vx = path.velocity_mm_per_s(recorded.felt.t_s)[0]
        error = np.abs(recorded.felt.mu - recorded.target_mu) / (0.11 * recorded.target_mu)
        ways = {
            way: float(np.percentile(error[(sign * vx > 90) & recorded.is_reachable], 95))
            for way, sign in (("there", 1), ("back", -1))
        }
        found[name] = {**ways, "live": live.evaluation.error_p95_jnd}
        print(f"  {name:8} " + "   ".join(f"{key} {one:.3f}" for key, one in found[name].items()))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--base", type=Path, help="working tree of the earlier state")
    parser.add_argument("--batches", type=int, default=BATCHES)
    parser.add_argument("--seconds", type=float, default=10.0, help="in real time")
    parser.add_argument("--json", type=Path, help="where to write all figures")
    parser.add_argument("--work", nargs="+", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.work:
        work(given.work)
        return
    print("blocks; a ratio is to one still photograph, of the earlier state where there is one")
    found: dict[str, Any] = {"blocks": blocks(given.base, given.batches)}
    print("a photograph of 2 megapixels")
    found["photograph"] = photograph()
    print("ten moving sprites in real time")
    found["real time"] = in_real_time(given.seconds)
    print("felt on a recorded path, 95 % of the errors are below (JND)")
    found["felt"] = felt()
    if given.json:
        given.json.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
