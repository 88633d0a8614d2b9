"""Compact spectral textures against recordings that they were not made for.

    .venv/bin/python benchmarks/spectral_textures.py ../shared/data/fabricslide

FabricSlide (Wang et al., Front. Neurorobot. 16, 808222 (2022)): a tactile finger, no human one,
slides over boards with two patterns, at four speeds and three forces; 36 readings a second. Its
capacitances are taken as if they were friction, at their places: two spectra, not two frictions.
Channels are added as energies. Levels are those asked for, not felt.
"""

from __future__ import annotations

import re
import sys
from itertools import combinations
from pathlib import Path

import numpy as np

from haptix.feel.materials.spectral import (
    BANDS_HZ,
    Energies,
    Stretch,
    band_energies,
    distance_db,
    fit,
)

SPEEDS = np.linspace(20, 100, 9)


def stretches_of(path: Path, speed: float) -> list[Stretch]:
    """One stretch for each channel, over its slow course."""
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    x = (table[:, 0] - table[0, 0]) / 1e3 * speed
    step = float(np.median(np.diff(x)))
    grid = np.arange(0, x[-1], step)
    found = []
    for channel in table[:, 3:].T:
        values = np.interp(grid, x, channel)
        half = round(10 / step)
        kernel = np.hanning(2 * half + 3)[1:-1]
        course = np.convolve(np.pad(values, half, "reflect"), kernel / kernel.sum(), "valid")
        found.append(Stretch(step, values / course - 1, 1.0, speed, 1.0))
    return found


def main() -> None:
    """Print what the page quotes."""
    files = {}
    for path in sorted(Path(sys.argv[1]).glob("Board*.csv")):
        board, force, speed = re.match(r"Board(\d+)mm_F(\d+)_V-(\d+)mmps", path.name).groups()
        if int(speed) <= 10:  # faster ones have no band at 20 to 100 mm/s that all share
            files[board, force, int(speed)] = stretches_of(path, float(speed))
    energies = {name: Energies(parts) for name, parts in files.items()}
    near, all_of = 0, 0
    for name, parts in files.items():
        model = fit(parts)
        for speed in SPEEDS:
            x = np.arange(32768) * model.tile_mm / 32768
            asked = band_energies(model.friction(x, 0.0), 32768 / model.tile_mm * speed, True)
            off = 10 * np.log10(asked) - energies[name].levels_db(float(speed))
            near += int(np.sum(np.abs(off) <= 1))
            all_of += int(np.isfinite(off).sum())
    print(f"{len(files)} recordings: within 1 dB in {near} of {all_of} bands ({near / all_of:.0%})")
    same, other = [], []
    for a, b in combinations(files, 2):
        (same if a[0] == b[0] else other).append(distance_db(energies[a], energies[b]))
    print(f"same board: {np.median(same):.1f} dB ({min(same):.1f} to {max(same):.1f})")
    print(f"other board: {np.median(other):.1f} dB ({min(other):.1f} to {max(other):.1f})")
    nearest = 0
    for a in files:
        by = min((b for b in files if b != a), key=lambda b: distance_db(energies[a], energies[b]))
        nearest += by[0] == a[0]
    print(f"nearest other recording is of the same board: {nearest} of {len(files)}")
    print("bands", [f"{low:.0f}" for low in BANDS_HZ])


if __name__ == "__main__":
    main()
