"""A sheet with a grating slides in under a moving finger: the texture's edge moves.

    python examples/moving_edge.py [--edge-mm-per-s 15] [--device usb:] [--out moving_edge.png]

The sheet is a region of a layout, which is moved at each touch. What is moved plays one reaction
later, so it shows the sheet where that will be then. The finger is simulated. On the mock in steps
it is reported 20 ms late, and a virtual finger says what it felt; any other device plays it in real
time.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import typer

import haptix
from haptix.feel import Grating, as_mu
from haptix.play import VirtualFinger, evaluate, events_of, paced

try:
    from matplotlib.figure import Figure
except ModuleNotFoundError as error:
    sys.exit(f"needs {error.name}; run: pip install 'haptix-electrovibration[figures]'")

SECONDS, RIGHT_MM, LATENCY_S = 2.5, 60.0, 0.02
GRATING = Grating(period_mm=5.0, wave="square", low=0.15, high=0.85)  # shares of what is reachable


def main(
    edge_mm_per_s: float = 15.0,
    device: str = "mock:pace=stepped",
    out: Path = Path("moving_edge.png"),
) -> None:
    def edge_mm(t_s: Any) -> Any:  # from the middle of the screen to the left
        return np.maximum(45.0 - edge_mm_per_s * t_s, 0.0)

    t = np.arange(0.0, SECONDS, 0.01)
    x = RIGHT_MM / 2 - 26 * np.cos(2 * np.pi * 0.8 * t + 0.5 * np.sin(3 * t))
    path = haptix.Trajectory(t, x, np.full_like(t, 20.0), 0.5 + 0.15 * np.sin(3 * t))
    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    ranges = {"normal_force_n": (0.3, 0.7), "frequency_hz": 4000}
    surface = haptix.FrictionSurface.build(model, ranges)

    opened = haptix.open_device(device)
    mock = opened.mock
    in_time = mock is None or mock.pace == "real"
    late_s = 0.0 if in_time else LATENCY_S
    layout = haptix.Layout()
    region = layout.add(GRATING, 100.0, 0.0, 100.0, 60.0)
    with haptix.LiveRenderer(surface, layout, opened) as renderer:
        began_s = renderer.now_s() if in_time else 0.0
        for event in paced(events_of(path), clock=renderer.now_s) if in_time else events_of(path):
            renderer.run_until(event.t_s + late_s)
            played_s = event.t_s - began_s + late_s + renderer.settings.reaction_s
            left_mm = float(edge_mm(played_s))
            region.move(left_mm, 0.0, over_s=0.0)
            renderer.event(event)
    print(renderer.stats)
    if mock is None or in_time:
        return

    played = mock.played_v
    felt = VirtualFinger(model).feel(played, renderer.sample_rate_hz, t, *path.at(t))
    on_sheet = felt.x_mm - edge_mm(felt.t_s)
    share = np.where(on_sheet > 0, GRATING.friction(on_sheet, felt.y_mm), 0.0)
    reachable = renderer.reachable(felt.normal_force_n, felt.speed_mm_per_s)
    target = as_mu("share", share, *reachable)
    evaluation = evaluate(felt, target)

    figure = Figure(figsize=(10, 9), layout="constrained")
    place, friction, voltage = figure.subplots(3, 1, sharex=True, height_ratios=(2, 1.2, 1))
    at_s, at_mm = np.meshgrid(np.linspace(0, t[-1], 600), np.linspace(0, RIGHT_MM, 400))
    from_left = at_mm - edge_mm(at_s)
    sheet = np.where(from_left > 0, GRATING.friction(from_left, 0 * from_left), 0.0)
    place.imshow(sheet, cmap="Greys", vmax=1.6, extent=(0, t[-1], RIGHT_MM, 0), aspect="auto")
    place.plot(at_s[0], edge_mm(at_s[0]), color="tab:orange", lw=2, label="edge of the sheet")
    place.plot(t, x, color="tab:red", lw=2, label="finger")
    place.set(ylabel="x on the screen (mm)", title="1  A grating slides in under a moving finger")
    place.legend(loc=(0.2, 0.81))
    friction.plot(felt.t_s, target, color="tab:orange", lw=2.5, label="target under the finger")
    friction.plot(felt.t_s, felt.mu, color="tab:blue", lw=1, label="felt by the virtual finger")
    friction.set(
        ylabel="friction coefficient",
        title=f"2  Touches come {LATENCY_S * 1e3:g} ms late and are played "
        f"{renderer.settings.reaction_s * 1e3:g} ms later; error "
        f"{evaluation.error_rms_jnd:.1f} JND (rms)",
    )
    friction.margins(y=0.3)
    friction.legend(loc="upper left", ncols=2)
    voltage.plot(
        np.arange(len(played)) / renderer.sample_rate_hz, played, color="tab:purple", lw=0.3
    )
    title = "3  Voltage: none beside the sheet, and for a moment none where the finger turns"
    voltage.set(xlabel="time (s)", ylabel="played (V)", xlim=(0, t[-1]), title=title)
    figure.savefig(out, dpi=110)
    print(f"{out}: {evaluation.error_rms_jnd:.2f} JND rms")


if __name__ == "__main__":
    try:
        typer.run(main)
    except (haptix.HaptixError, OSError) as error:
        sys.exit(f"moving_edge: {error}")
