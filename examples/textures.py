"""Textures of every kind on one screen, and how much of them the surface can render.

    python examples/textures.py [folder]

Writes textures.png, the target friction at two speeds of the finger, and headroom.png, the part
of it in the reachable range at 0.5 N.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np

import haptix
from haptix.feel import Grating, Motion, Noise, RecordedProfile, Texture, headroom, power_law

try:
    from matplotlib.figure import Figure
    from skimage.data import brick, gravel
except ModuleNotFoundError as error:
    sys.exit(f"needs {error.name}; run: pip install 'haptix-electrovibration[figures]'")

WIDTH_MM, HEIGHT_MM = 120.0, 70.0
ENVELOPE_RATE_HZ = 200.0  # direct drive at 100 Hz, which attracts twice in each period


def screen() -> haptix.Layout:
    """Values are changes from the friction without voltage, as a part of it."""
    up_to: dict[str, Any] = {"target": "contrast", "low": 0.0, "high": 0.55}
    photograph = Texture.from_image(brick(), 40.0, **up_to)
    stones = Texture.from_heights(gravel(), 35.0, "slope-magnitude", **up_to)
    x = np.linspace(0, 30, 301)
    detents = RecordedProfile(x, 0.5 * np.exp(-(((x % 6 - 3) / 0.6) ** 2)), "contrast")
    ground = Noise(
        spectrum=power_law(2.5, 0.5, 12), mean=0.1, deviation=0.04, target="contrast", seed=1
    )
    layout = haptix.Layout(ground, "contrast")
    layout.add(photograph, 4.0, 4.0)
    layout.add(stones, 48.0, 4.0, shape="ellipse")
    layout.add(
        Grating(period_mm=3.0, wave="square", orientation_deg=20.0, **up_to), 87.0, 4.0, 29.0, 16.0
    )
    layout.add(
        Grating(period_mm=5.0, wave="sawtooth", orientation_deg=90.0, **up_to),
        87.0,
        23.0,
        29.0,
        16.0,
    )
    layout.add(detents, 48.0, 48.0, 30.0, 16.0)
    layout.add(
        Grating(period_mm=4.0, wave="sine", orientation_deg=-30.0, **up_to),
        82.0,
        46.0,
        34.0,
        20.0,
        blend="max",
    )
    return layout


def main() -> None:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    folder.mkdir(parents=True, exist_ok=True)
    layout = screen()
    x, y = np.meshgrid(
        (np.arange(960) + 0.5) * WIDTH_MM / 960, (np.arange(560) + 0.5) * HEIGHT_MM / 560
    )
    figure = Figure(figsize=(9, 10), layout="constrained")
    for axes, speed in zip(figure.subplots(2, 1), (0.0, 200.0), strict=True):
        motion = Motion.of(x, y, footprint_mm=speed / ENVELOPE_RATE_HZ)
        value = layout.wanted(motion).reshape(x.shape)
        picture = axes.imshow(value, extent=(0, WIDTH_MM, HEIGHT_MM, 0), vmin=0, vmax=0.55)
        shortest = 2 * speed / ENVELOPE_RATE_HZ
        axes.set(
            title="at a point"
            if speed == 0
            else f"for a finger of {speed:g} mm/s and {ENVELOPE_RATE_HZ:g} samples/s: "
            f"waves above {shortest:g} mm",
            xlabel="x on the screen (mm)",
            ylabel="y (mm)",
        )
        figure.colorbar(picture, ax=axes, label="change of friction, as a part of it")
    figure.savefig(folder / "textures.png", dpi=110)

    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    surface = haptix.FrictionSurface.build(model, {"normal_force_n": (0.3, 1), "frequency_hz": 200})
    found = headroom(layout, surface, 0.5, WIDTH_MM, HEIGHT_MM)
    (folder / "headroom.png").write_bytes(found.png())
    for name, number in found.numbers().items():
        print(f"{name}: {number:.4g}")


if __name__ == "__main__":
    main()
