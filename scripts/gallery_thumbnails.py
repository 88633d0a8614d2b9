"""Draw the thumbnails of the gallery's presets into the package; run it after changing one."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from PIL import Image

from haptix.base.files import write_whole
from haptix.feel.gallery import FOLDER, Preset, presets
from haptix.feel.materials.picture import picture

COLUMNS, ROWS = 96, 72
FINE = ("ribs", "weaves", "grains")
CLOSE_UP = 0.5  # of their sides: ribs of a millimetre would be two pixels wide
PEAK_S = 0.06  # of the heartbeat
SHADES = 48
COLORS = (colormaps["viridis"](np.linspace(0, 1, SHADES))[:, :3] * 255).round().astype(np.uint8)


def thumbnail(preset: Preset) -> Image.Image:
    """Draw the middle of a preset, in the colours of the studio's friction map."""
    share = CLOSE_UP if preset.family in FINE else 1.0
    width_mm, height_mm = share * preset.width_mm, share * preset.height_mm
    scale = max(width_mm / COLUMNS, height_mm / ROWS)
    columns = round(width_mm / scale)
    wanted = picture(preset.material, width_mm, height_mm, 4 * columns, PEAK_S, sweeps=True)
    wanted = wanted[: 4 * ROWS]
    rows = wanted.shape[0] // 4
    # The mean of 4 x 4 places, so that fine ribs do not make stripes that are not there.
    mean = np.clip(wanted, 0, 1)[: 4 * rows].reshape(rows, 4, columns, 4).mean((1, 3))
    shade = (mean * (SHADES - 1)).round()
    drawn = Image.fromarray(shade.astype(np.uint8), "P")
    drawn.putpalette(COLORS.tobytes())
    return drawn


def main() -> None:
    """Write them all."""
    for preset in presets():
        target = FOLDER / "thumbnails" / f"{preset.name}.png"
        write_whole(
            target, lambda draft, one=preset: thumbnail(one).save(draft, "PNG", optimize=True)
        )


if __name__ == "__main__":
    main()
