"""A slider whose detents are felt: each step of its value is a ridge of friction.

    python examples/slider_with_detents.py [--steps 8] [--device usb:] [--out slider.png]

Friction rises between two values and falls into the next, and stays high beyond the ends. The
program reads the value where the touches say the finger is, and never needs to know where the
ridges are felt. The finger is simulated. On the mock it moves in steps, is reported 20 ms
late, and a virtual finger says what it felt; any other device plays it in real time.
"""

import sys
from pathlib import Path

import numpy as np
import typer

import haptix
from haptix.feel import RecordedProfile, as_mu
from haptix.play import VirtualFinger, evaluate, events_of, paced

try:
    from matplotlib.figure import Figure
except ModuleNotFoundError as error:
    sys.exit(f"needs {error.name}; run: pip install 'haptix-electrovibration[figures]'")

LEFT_MM, LENGTH_MM, RIDGE_MM, SECONDS, LATENCY_S = 10.0, 60.0, 1.2, 3.0, 0.02


def detents(steps: int) -> RecordedProfile:
    """Share of the reachable friction along x: a ridge between neighbours, walls at the ends."""
    most = int(LENGTH_MM / (3 * RIDGE_MM))
    if not 2 <= steps <= most:
        raise haptix.InputError(
            f"--steps: expected 2 to {most}, got {steps}; with more, ridges of {RIDGE_MM:g} mm "
            "would run together"
        )
    width_mm = LENGTH_MM / steps
    x = np.linspace(0.0, 2 * LEFT_MM + LENGTH_MM, 1601)
    on = x - LEFT_MM
    to_ridge = np.abs(on - width_mm * np.clip(np.round(on / width_mm), 1, steps - 1))
    ridges = np.exp(-((to_ridge / (RIDGE_MM / 2)) ** 2))
    walls = np.clip(np.maximum(-on, on - LENGTH_MM) / RIDGE_MM, 0.0, 1.0)
    return RecordedProfile(x, 0.95 * np.maximum(ridges, walls), "share", beyond="hold")


def main(
    steps: int = 8, device: str = "mock:pace=stepped", out: Path = Path("slider_with_detents.png")
) -> None:
    slider = detents(steps)
    t = np.arange(0.0, SECONDS, 0.01)
    stop = np.array([[0.0, 14.0], [0.2, 14.0], [1.3, 74.0], [1.7, 74.0], [2.4, 32.0], [3.0, 32.0]])
    x = np.interp(t, *stop.T)
    x = np.convolve(np.pad(x, 8, mode="edge"), np.hanning(17) / np.hanning(17).sum(), "valid")
    path = haptix.Trajectory(t, x, np.full_like(t, 30.0), np.full_like(t, 0.5))
    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    surface = haptix.FrictionSurface.build(model, {"normal_force_n": 0.5, "frequency_hz": 4000})

    opened = haptix.open_device(device)
    mock = opened.mock
    in_time = mock is None or mock.pace == "real"
    value, values = 0, []
    with haptix.LiveRenderer(surface, slider, opened) as renderer:
        for event in paced(events_of(path), clock=renderer.now_s) if in_time else events_of(path):
            renderer.event(event, None if in_time else event.t_s + LATENCY_S)
            at = (event.x_mm - LEFT_MM) / LENGTH_MM * steps - 0.5  # 0 in the middle of value 0
            if abs(at - value) > 0.55:  # past the ridge, so that its top does not flicker
                value = int(np.clip(round(at), 0, steps - 1))
            values.append(value)
    print(renderer.stats)
    if mock is None or in_time:
        return

    played = mock.played_v
    felt = VirtualFinger(model).feel(played, renderer.sample_rate_hz, t, *path.at(t))
    reachable = renderer.reachable(felt.normal_force_n, felt.speed_mm_per_s)
    target = as_mu("share", slider.friction(felt.x_mm, felt.y_mm), *reachable)
    evaluation = evaluate(felt, target)

    figure = Figure(figsize=(10, 8.5), layout="constrained")
    place, value_at, along = figure.subplots(3, 1, height_ratios=(1.2, 0.7, 1.4))
    screen_mm = np.linspace(0, 2 * LEFT_MM + LENGTH_MM, 1000)
    share = slider.friction(screen_mm, 0 * screen_mm)
    place.imshow(share[:, None], cmap="Greys", vmax=1.5, extent=(0, SECONDS, 80, 0), aspect="auto")
    place.plot(t, x, color="tab:red", lw=2, label="finger")
    place.set(ylabel="x on the screen (mm)", title="1  Ridges of friction (grey) across the way")
    place.legend(loc="upper right")
    value_at.step(t, values[: len(t)], where="post", color="tab:green", lw=2)
    value_at.set(
        xlim=(0, SECONDS), xlabel="time (s)", ylabel="value", title="2  What the program reads"
    )
    for goes, colour, name in ((1, "tab:blue", "felt, going right"), (-1, "tab:cyan", "left")):
        mine = np.sign(np.gradient(felt.x_mm, felt.t_s).round(1)) == goes
        along.plot(felt.x_mm, np.where(mine, felt.mu, np.nan), color=colour, lw=1, label=name)
    order = np.argsort(felt.x_mm)
    along.plot(felt.x_mm[order], target[order], color="tab:orange", lw=3, zorder=0, label="target")
    along.set(
        xlabel="x on the screen (mm)",
        ylabel="friction coefficient",
        title="3  Friction along the slider: the prediction errs where the finger starts and stops;"
        f" {evaluation.error_rms_jnd:.1f} JND (rms)",
    )
    along.margins(y=0.25)
    along.legend(loc="upper center", ncols=3)
    figure.savefig(out, dpi=110)
    print(f"{out}: value {value}, {evaluation.error_rms_jnd:.2f} JND rms")


if __name__ == "__main__":
    try:
        typer.run(main)
    except (haptix.HaptixError, OSError) as error:
        sys.exit(f"slider_with_detents: {error}")
