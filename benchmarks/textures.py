"""Textures: microseconds for a block, aliases in decibels, seconds to make one.

    .venv/bin/python benchmarks/textures.py

A block is 48 places, 1 ms at 48 kHz, along a stroke of 100 mm/s. Times are the fastest of 20 runs
of 500 blocks in one thread. Aliases: power above half of the envelope's rate, on a stroke read 32
times as densely, against the variance of the point values; kept: the deviation below it, against
that of the point values there.
"""

import time
import timeit

import numpy as np
from skimage.data import brick

from haptix.feel.materials import (
    FrictionField,
    Grating,
    Noise,
    RecordedProfile,
    Texture,
    power_law,
)

SAMPLES = 48
SPEED_MM_PER_S = 100.0


def fields() -> dict[str, FrictionField]:
    rng = np.random.default_rng(0)
    photograph = Texture.from_image(brick(), width_mm=60)
    return {
        "photograph, 512 x 512 on 60 mm": photograph,
        "grating, sine": Grating(period_mm=2.0),
        "grating, square": Grating(period_mm=2.0, wave="square", orientation_deg=30.0),
        "noise, 1024 x 1024": Noise(spectrum=power_law(2, 0.3, 10)),
        "noise, ribbed": Noise(spectrum=power_law(2, 0.3, 10), grain="ribbed", orientation_deg=20),
        "recording, 600 steps": RecordedProfile(np.arange(600) / 10, rng.uniform(0.2, 0.4, 600)),
    }


def block_us(field: FrictionField, footprint_mm: float) -> float:
    t = np.arange(SAMPLES) / 48_000
    x, y = 20 + 0.8 * SPEED_MM_PER_S * t, 20 + 0.6 * SPEED_MM_PER_S * t
    runs = timeit.repeat(lambda: field.friction(x, y, footprint_mm), number=500, repeat=20)
    return min(runs) / 500 * 1e6


def aliases(field: FrictionField, footprint_mm: float) -> tuple[float, float]:
    step = footprint_mm / 32
    along = np.arange(int(35 / step)) * step
    x, y = 5 + 0.9 * along, 5 + 0.4 * along
    window = np.hanning(len(along))

    def power(value: np.ndarray) -> np.ndarray:
        value = value - np.average(value, weights=window)
        return np.abs(np.fft.rfft(value * window)) ** 2

    limited, whole = power(field.friction(x, y, footprint_mm)), power(field.friction(x, y))
    above = np.fft.rfftfreq(len(along), step) > 1 / (2 * footprint_mm)
    decibels = 10 * np.log10(limited[above].sum() / whole.sum() + 1e-30)
    return float(decibels), float(np.sqrt(limited[~above].sum() / whole[~above].sum()))


def main() -> None:
    footprints = {"48 kHz": 48_000, "4 kHz": 4_000, "1.2 kHz": 1_200, "250 Hz": 250, "100 Hz": 100}
    print(f"envelope rate, at {SPEED_MM_PER_S:g} mm/s        {'   '.join(footprints)}")
    for name, field in fields().items():
        print(name)
        times, kept, folded = [], [], []
        for rate in footprints.values():
            footprint = SPEED_MM_PER_S / rate
            times.append(block_us(field, footprint))
            decibels, part = aliases(field, footprint)
            folded.append(decibels)
            kept.append(part)
        print("  block of 48 [us]  ", "  ".join(f"{value:7.1f}" for value in times))
        print("  aliases [dB]      ", "  ".join(f"{value:7.0f}" for value in folded))
        print("  kept              ", "  ".join(f"{value:7.2f}" for value in kept))
    print("making a texture from a photograph of")
    for side in (512, 2048, 4096):
        pixels = np.random.default_rng(0).integers(0, 256, (side, side)).astype(np.uint8)
        began = time.perf_counter()
        Texture.from_image(pixels, 60)
        print(f"  {side} x {side} pixels: {time.perf_counter() - began:.2f} s")


if __name__ == "__main__":
    main()
