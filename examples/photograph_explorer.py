"""Explore a photograph with a finger, live, and hear from the finger what it felt.

    python examples/photograph_explorer.py [photo.png] [--width-mm 60] [--path path.csv]
        [--device usb:] [--out photograph_explorer.png]

The finger's path is a recording (CSV: t_s, x_mm, y_mm, normal_force_n). On the mock it is played in
steps: a touch panel reports it at 100 Hz and 20 ms late, the renderer predicts where the
finger is, and a virtual finger feels what went out at the place where it truly was. Any other
device plays the recording in real time, for a finger that moves the same way.
"""

import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import haptix
from haptix.feel import as_mu
from haptix.play import (
    FINGER_PATH,
    TouchEvent,
    TouchPanel,
    VirtualFinger,
    evaluate,
    events_of,
    paced,
)

try:
    from matplotlib.figure import Figure
    from skimage.data import brick
except ModuleNotFoundError as error:
    sys.exit(f"needs {error.name}; run: pip install 'haptix-electrovibration[figures]'")


def main(
    photograph: Annotated[Path | None, typer.Argument(help="[default: a brick wall]")] = None,
    width_mm: float = 60.0,
    path: Path = FINGER_PATH,
    device: str = "mock:pace=stepped",
    out: Path = Path("photograph_explorer.png"),
) -> None:
    texture = haptix.Texture.from_image(photograph or brick(), width_mm)
    finger = haptix.Trajectory.from_csv(path)
    inside = (finger.x_mm >= 0) & (finger.x_mm <= width_mm)
    inside &= (finger.y_mm >= 0) & (finger.y_mm <= texture.height_mm)
    if inside.mean() < 0.5:
        raise haptix.InputError(
            f"the photograph is {width_mm:g} mm by {texture.height_mm:.0f} mm on the screen, and "
            f"{1 - inside.mean():.0%} of the path lies beside it; give another --width-mm or --path"
        )
    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    force = (float(finger.normal_force_n.min()), float(finger.normal_force_n.max()))
    surface = haptix.FrictionSurface.build(model, {"normal_force_n": force, "frequency_hz": 4000})

    opened = haptix.open_device(device)
    mock = opened.mock
    in_time = mock is None or mock.pace == "real"
    true = (finger.t_s, finger.x_mm, finger.y_mm, finger.normal_force_n)
    with haptix.LiveRenderer(surface, texture, opened) as renderer:
        if in_time:
            for event in paced(events_of(finger), clock=renderer.now_s):
                renderer.event(event)
        else:
            seen = TouchPanel(rate_hz=100, latency_s=0.02).read(finger)
            for t, arrival, x, y, n in zip(
                seen.t_s, seen.arrival_s, seen.x_mm, seen.y_mm, seen.normal_force_n, strict=True
            ):
                renderer.event(TouchEvent(t, 0, x, y, "move", n), arrival)
    print(renderer.stats)
    if mock is None or in_time:
        return

    played, rate_hz = mock.played_v, renderer.sample_rate_hz
    felt = VirtualFinger(model).feel(played, rate_hz, *true)
    lowest, highest = renderer.reachable(felt.normal_force_n, felt.speed_mm_per_s)
    target = as_mu("share", texture.friction(felt.x_mm, felt.y_mm), lowest, highest)
    evaluation = evaluate(felt, target)
    told = f"{evaluation.error_rms_jnd:.2f} JND rms, 95 % within {evaluation.error_p95_jnd:.2f}"

    figure = Figure(figsize=(12, 9), layout="constrained")
    grid = figure.add_gridspec(3, 2, height_ratios=(1.8, 1, 0.7))
    place, map_ = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    extent = (0, width_mm, texture.height_mm, 0)
    place.imshow(texture.level, cmap="gray", extent=extent)
    place.plot(finger.x_mm, finger.y_mm, color="tab:red", lw=2)
    place.plot(finger.x_mm[0], finger.y_mm[0], "o", color="tab:red")
    place.set(xlabel="x (mm)", ylabel="y (mm)", title="1  Photograph, and the finger's path")
    dots = map_.scatter(
        felt.x_mm[::5], felt.y_mm[::5], c=(felt.mu / lowest - 1)[::5] * 100, s=14, cmap="gray"
    )
    map_.set(xlim=extent[:2], ylim=extent[2:], aspect="equal", facecolor="#cfe3f2")
    map_.set(xlabel="x (mm)", title="2  What the finger felt there")
    figure.colorbar(dots, ax=map_, label="friction above that without voltage (%)")
    friction = figure.add_subplot(grid[1, :])
    friction.fill_between(felt.t_s, lowest, highest, color="0.92", label="reachable at this force")
    friction.plot(felt.t_s, target, color="tab:orange", lw=2.5, label="target under the finger")
    friction.plot(felt.t_s, felt.mu, color="tab:blue", lw=0.8, label="felt")
    friction.set(ylabel="friction coefficient", title=f"3  Friction: an error of {told}")
    friction.margins(x=0, y=0.25)
    friction.legend(loc="upper right", ncols=3)
    voltage = figure.add_subplot(grid[2, :], sharex=friction)
    at_s = np.arange(len(played)) / rate_hz
    voltage.plot(at_s, played, color="tab:purple", lw=0.2)
    voltage.set(xlabel="time (s)", ylabel="played (V)", title="4  Voltage: a 4 kHz carrier")
    figure.savefig(out, dpi=110)
    print(f"{out}: {told}")


if __name__ == "__main__":
    try:
        typer.run(main)
    except (haptix.HaptixError, OSError) as error:
        sys.exit(f"photograph_explorer: {error}")
