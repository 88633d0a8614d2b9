"""Two fingers on two textures, over one electrode: the target of each, and what both feel.

    python examples/two_fingers.py [--combination strongest] [--device usb:] [--out fingers.png]

A screen has one voltage for all fingers on it, so two of them cannot feel two textures at once.
`combination` says whose amplitude counts: the strongest, the first finger's, or the mean. A finger
alone gets its own target. The fingers are simulated. On the mock they move in virtual time and are
reported 20 ms late, and a virtual finger in the place of each says what it felt; any other device
plays them in real time.
"""

import sys
from pathlib import Path
from typing import Literal

import numpy as np
import typer

import haptix
from haptix.feel import Grating, Motion, Texture, as_mu
from haptix.play import LiveSettings, VirtualFinger, evaluate, events_of, paced

try:
    from matplotlib.figure import Figure
    from skimage.data import brick
except ModuleNotFoundError as error:
    sys.exit(f"needs {error.name}; run: pip install 'haptix-electrovibration[figures]'")

LATENCY_S = 0.02
COLOURS = ("tab:red", "tab:blue")
SCREEN = haptix.Layout()
SCREEN.add(Grating(period_mm=6.0, wave="sine", low=0.0, high=0.9), 0.0, 0.0, 50.0, 40.0)
SCREEN.add(Texture.from_image(brick(), 50.0, high=0.9), 50.0, 0.0, 50.0, 40.0)


def stroke(begin_s: float, end_s: float, left_mm: float, y_mm: float) -> haptix.Trajectory:
    t = np.arange(begin_s, end_s, 0.01)
    x = left_mm + 20 - 20 * np.cos(2 * np.pi * 0.55 * (t - begin_s))
    force = 0.5 + 0.1 * np.sin(4 * t)
    return haptix.Trajectory(t, x, y_mm + 6 * np.sin(1.5 * t), force)


def main(
    combination: Literal["strongest", "first", "mean"] = "strongest",
    device: str = "mock:pace=stepped",
    out: Path = Path("two_fingers.png"),
) -> None:
    paths = [stroke(0.0, 2.0, 5.0, 18.0), stroke(1.0, 3.0, 55.0, 18.0)]
    events = [event for touch_id, path in enumerate(paths) for event in events_of(path, touch_id)]
    events.sort(key=lambda event: event.t_s)
    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    ranges = {"normal_force_n": (0.3, 0.7), "frequency_hz": 4000}
    surface = haptix.FrictionSurface.build(model, ranges)

    opened = haptix.open_device(device)
    mock = opened.mock
    in_time = mock is None or mock.pace == "real"
    settings = LiveSettings(combination=combination)
    with haptix.LiveRenderer(surface, SCREEN, opened, settings=settings) as renderer:
        for event in paced(events, clock=renderer.now_s) if in_time else events:
            renderer.event(event, None if in_time else event.t_s + LATENCY_S)
    print(renderer.stats)
    if mock is None or in_time:
        return

    rate_hz, played = renderer.sample_rate_hz, mock.played_v
    figure = Figure(figsize=(11, 10), layout="constrained")
    grid = figure.add_gridspec(4, 1, height_ratios=(1.6, 1, 1, 0.8))
    place = figure.add_subplot(grid[0])
    x, y = np.meshgrid(np.linspace(0, 100, 800), np.linspace(0, 40, 320))
    share = SCREEN.wanted(Motion.of(x, y)).reshape(x.shape)
    place.imshow(share, cmap="gray", extent=(0, 100, 40, 0))
    place.set(xlabel="x (mm)", ylabel="y (mm)", title="1  Two textures, and a finger on each")
    axes = None
    for number, (path, colour) in enumerate(zip(paths, COLOURS, strict=True), 1):
        true = (path.t_s, path.x_mm, path.y_mm, path.normal_force_n)
        felt = VirtualFinger(model).feel(played, rate_hz, *true)
        reachable = renderer.reachable(felt.normal_force_n, felt.speed_mm_per_s)
        target = as_mu("share", SCREEN.wanted(Motion.of(felt.x_mm, felt.y_mm)), *reachable)
        other = paths[2 - number]
        together = (felt.t_s >= other.t_s[0]) & (felt.t_s <= other.t_s[-1] + LATENCY_S)
        alone, both = (
            evaluate(felt, np.where(mask, target, np.nan)).error_rms_jnd
            for mask in (~together, together)
        )
        print(f"finger {number}: {alone:.2f} JND rms alone, {both:.2f} with the other")
        place.plot(path.x_mm, path.y_mm, color=colour, lw=2.5, label=f"finger {number}")
        axes = figure.add_subplot(grid[number], sharex=axes)
        axes.plot(felt.t_s, target, color="0.6", lw=3, label="target of its texture")
        axes.plot(felt.t_s, felt.mu, color=colour, lw=0.9, label="felt")
        axes.axvspan(1.0, 2.0, color="tab:orange", alpha=0.12, lw=0, label="both fingers down")
        axes.set(
            ylabel="friction coefficient",
            title=f"{number + 1}  Finger {number}: {alone:.1f} JND of error alone"
            f" (rms), {both:.1f} with the other",
        )
        axes.margins(y=0.3)
        axes.legend(loc="upper left" if number == 2 else "upper right", ncols=3)
    place.legend(loc="upper right", ncols=2)
    voltage = figure.add_subplot(grid[3], sharex=axes)
    voltage.plot(np.arange(len(played)) / rate_hz, played, color="tab:purple", lw=0.3)
    voltage.axvspan(1.0, 2.0, color="tab:orange", alpha=0.12, lw=0)
    title = f"4  The one voltage for both: {combination}"
    voltage.set(xlim=(0, 3), xlabel="time (s)", ylabel="played (V)", title=title)
    figure.savefig(out, dpi=110)


if __name__ == "__main__":
    try:
        typer.run(main)
    except (haptix.HaptixError, OSError) as error:
        sys.exit(f"two_fingers: {error}")
