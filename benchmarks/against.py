"""The renderer's times against those of another checkout, measured in turns in one run.

    .venv/bin/python benchmarks/against.py ../old [--rounds 30]

The other checkout has an environment of its own in .venv. A block is 1 ms at 48 kHz; its time runs
from asking the touches for the fingers' paths to the drive samples. A recorded path of 20 s is
rendered offline, with limits, wire and the mock driver and without them. Of blocks the median and
the 99th percentile count, of recorded paths the shortest time.
"""

from __future__ import annotations

import argparse
import gc
import importlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

RATE_HZ, STEP, BLOCK = 48_000.0, 4, 48
PATH_S = 20.0
BLOCKS = 1000  # of a round


def works() -> Iterator[tuple[str, Callable[[], list[float]]]]:
    """Name each measurement, with what takes its times [s]; runs in either checkout."""
    import torch
    from skimage.data import brick

    import haptix

    torch.set_num_threads(1)
    finger, screen = haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    ranges = {"normal_force_n": (0.1, 1.0), "frequency_hz": 4000.0}
    model = haptix.ContactModel(finger, screen)
    surface = haptix.FrictionSurface.build(model, ranges, tolerance=5e-4).at(4000.0)
    texture = haptix.Texture.from_image(brick(), width_mm=60)
    for fingers in (1, 10):
        yield f"block, {fingers} finger{'s' * (fingers > 1)}", blocks(surface, texture, fingers)
    yield "recorded path, bare", recorded(surface, texture, bare=True)
    yield "recorded path, limits, wire, mock", recorded(surface, texture, bare=False)


def blocks(surface: Any, texture: Any, fingers: int) -> Callable[[], list[float]]:
    from firmware_io import open_device
    from haptix.play.render import LiveSettings, RenderCore, RenderSettings, SineCarrier
    from haptix.play.touch import TouchEvent, TouchSettings

    try:
        fingers_of: Any = importlib.import_module("haptix.play.render.fingers").PredictedFingers
    except ImportError:  # of a version before
        fingers_of = importlib.import_module("haptix.play.render.revised_fingers").RevisedFingers

    touches = fingers_of(LiveSettings(touch=TouchSettings(lost_after_s=600.0)))
    for i in range(30):
        for finger in range(fingers):
            x, y, force = 10 + 0.5 * i, 20.0 + finger, 0.5 + 0.005 * i
            touches.take(TouchEvent(0.01 * i, finger, x, y, "move", force))
    touches.update(0.29)
    settings = RenderSettings(block_s=1e-3)
    core = RenderCore(surface, texture, open_device("mock:"), SineCarrier(4000.0), settings)
    sample, amplitude_v = 0, 0.0

    def work() -> list[float]:
        nonlocal sample, amplitude_v
        times = []
        for _ in range(BLOCKS):
            began = time.perf_counter()
            at_s = 0.3 + 1e-6 * sample
            motion = touches.motion(at_s, STEP / RATE_HZ, BLOCK // STEP, sample / RATE_HZ)
            block = core.block(motion, sample, amplitude_v)
            sample, amplitude_v = sample + BLOCK, float(block.amplitude_v[-1])
            times.append(time.perf_counter() - began)
        return times

    return work


def recorded(surface: Any, texture: Any, bare: bool) -> Callable[[], list[float]]:
    import haptix
    from firmware_io import open_device
    from haptix.feel.motion import Trajectory

    t = np.arange(0, PATH_S, 0.01)
    x, y, force = 30 + 20 * np.sin(2 * t), 20 + 10 * np.cos(2.1 * t), 0.5 + 0.2 * np.sin(t)
    path = Trajectory(t, x, y, force)

    def work() -> list[float]:
        device = open_device("mock:")
        if bare:
            device.write = lambda volts: None  # type: ignore[method-assign]
        began = time.perf_counter()
        with haptix.Renderer(surface, texture, device) as renderer:
            renderer.play(path)
        spent = time.perf_counter() - began
        device.close()
        return [spent]

    return work


def serve() -> None:
    """Measure what is asked for on the standard input."""
    known = dict(works())
    gc.collect()
    gc.freeze()
    print(json.dumps(list(known)), flush=True)
    for line in sys.stdin:
        print(json.dumps(known[line.strip()]()), flush=True)


class Side:
    """One checkout, in a process of its own."""

    def __init__(self, root: Path) -> None:
        python = root / ".venv" / "bin" / "python"
        self._process = subprocess.Popen(
            [python, Path(__file__).resolve(), "--serve"], cwd=root, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": str(root), "PYTHONSAFEPATH": "1"},
        )  # fmt: skip
        self.names: list[str] = self._answer()

    def _answer(self) -> Any:
        assert self._process.stdout is not None
        return json.loads(self._process.stdout.readline())

    def times(self, name: str) -> list[float]:
        """Return the times [s] of one round."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{name}\n")
        self._process.stdin.flush()
        found: list[float] = self._answer()
        return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("other", type=Path, nargs="?", default=Path())
    parser.add_argument("--rounds", type=int, default=30)
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        return serve()
    sides = [Side(options.other.resolve()), Side(Path(__file__).resolve().parents[1])]
    for name in sides[0].names:
        rounds = options.rounds if name.startswith("block") else max(options.rounds // 4, 3)
        for side in sides:
            side.times(name)
        each = np.array([[side.times(name) for side in sides] for _ in range(rounds)])
        old, new = each.transpose(1, 0, 2).reshape(2, -1)
        if name.startswith("block"):
            for percent in (50, 99):
                a, b = (float(np.percentile(one, percent)) * 1e6 for one in (old, new))
                print(f"{name}, p{percent}: {a:.1f} us, now {b:.1f} us: {b / a:.2f}")
        else:
            a, b = (PATH_S / float(one.min()) for one in (old, new))
            print(f"{name}: {a:.0f} times real time, now {b:.0f}: {b / a:.2f} times as fast")


if __name__ == "__main__":
    main()
