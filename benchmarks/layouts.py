"""What a layout costs: a block of 1 ms, still and moving, and moving a photograph.

    .venv/bin/python benchmarks/layouts.py

Each row is the median of many; the ratio is to one still photograph without a layout, in one run.
"""

import time
from collections.abc import Callable

import numpy as np

import haptix
from haptix.motion import Motion
from haptix.render import PredictingRenderer
from haptix.render.core import Fingers
from haptix.texture import Feelable

POINTS, STEP_S, NOW_S, BLOCKS = 12, 1 / 12_000, 10.0, 2000


def median_us(call: Callable[[int], object], count: int = BLOCKS) -> float:
    times = []
    for i in range(count):
        began = time.perf_counter()
        call(i)
        times.append(time.perf_counter() - began)
    return float(np.median(times)) * 1e6


def renderer_of(texture: Feelable) -> PredictingRenderer:
    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    surface = haptix.FrictionSurface.build(model, {"normal_force_n": 0.5, "frequency_hz": 4000})
    return PredictingRenderer(surface, texture, haptix.open_device("mock:"))


def block_us(renderer: PredictingRenderer, texture: Feelable) -> float:
    """Whole blocks, from the motion of one finger at 100 mm/s to the samples."""
    renderer.texture = texture
    if isinstance(texture, haptix.Layout):
        texture.attach(lambda: NOW_S)
        for i, patch in enumerate(list(texture.patches.values())):
            patch.move(x_mm=patch.x_mm + i % 3, over_s=0.02)
    x = 20 + 0.1 / POINTS * np.arange(1.0, POINTS + 1)
    gain, force = np.ones(POINTS), np.full(POINTS, 0.5)

    def one(_: int) -> None:
        motion = Motion(
            1, POINTS, x, np.full(POINTS, 15.0), force, 0.1 / POINTS, STEP_S, NOW_S + 0.01,
            lambda: (np.full(POINTS, 100.0), np.zeros(POINTS)),
        )  # fmt: skip
        renderer.block(Fingers(motion, gain, [0.5]), 480_000, 50.0)

    return median_us(one)


def main() -> None:
    pixels = np.random.default_rng(0).random((1000, 2000))
    photograph = haptix.Texture.from_image(pixels, width_mm=60)
    layout = haptix.Layout()
    began = time.perf_counter()
    patch = layout.add(photograph)
    print(f"a photograph of 2 megapixels enters in {time.perf_counter() - began:.2f} s")
    now = [NOW_S]
    layout.attach(lambda: now[0])
    for regions in (1, 10, 100):
        while len(layout.patches) < regions:
            layout.add(photograph, 2.0 * len(layout.patches), 0, 30, 20)
        us = median_us(lambda i: patch.move(x_mm=i * 0.01))
        print(f"a move among {regions} regions: {us:.0f} us")
    renderer = renderer_of(photograph)
    alone = block_us(renderer, photograph)
    print(f"one still photograph: {alone:.0f} us a block")
    for name, step_mm in (("ten moving, side by side", 37.0), ("ten moving, on each other", 0.3)):
        scene = haptix.Layout()
        for k in range(10):
            scene.add(photograph, 5 + step_mm * k % 150, 5 + 0.2 * k, 30, 20)
        us = block_us(renderer, scene)
        print(f"{name}: {us:.0f} us a block, {us / alone:.1f} times")


if __name__ == "__main__":
    main()
