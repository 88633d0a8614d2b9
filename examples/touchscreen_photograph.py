"""A photograph under the fingers on a touchscreen of this machine.

    python examples/touchscreen_photograph.py /dev/input/event5 photo.png [--device usb:]

The touchscreen is read through evdev (the extra "evdev"); its time stamps are those of
`time.monotonic`, the clock of the renderer. Without a path it lists the touchscreens. Stop it with
Ctrl+C. Touches that come too late after a stall are dropped and counted.
"""

import sys
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

import haptix
from haptix.feel import LayoutEvent
from haptix.play import LiveSettings, Touchscreen, find_touchscreens


def follow(renderer: haptix.LiveRenderer, screen: Touchscreen, seconds: float) -> None:
    """Give a renderer what a touchscreen reports, until it is over or someone stops it."""
    end_s = renderer.now_s() + seconds
    while renderer.now_s() < end_s:
        for event in screen.read(timeout_s=0.01):
            renderer.event(event)


def main(
    path: Annotated[str | None, typer.Argument()] = None,
    photograph: Annotated[Path | None, typer.Argument()] = None,
    device: str = "mock:pace=real",
    width_mm: float | None = None,
    height_mm: float | None = None,
    seconds: float = float("inf"),
) -> None:
    if path is None or photograph is None:
        for found in find_touchscreens():
            print(found.path, found.name, *found.odd, sep="  ")
        raise haptix.InputError("give a touchscreen of this list, and a photograph")
    screen = Touchscreen(path, width_mm, height_mm)
    across_mm, down_mm = screen.axes.size_mm
    layout = haptix.Layout()
    layout.add(haptix.Texture.from_image(photograph, across_mm), 0, 0, across_mm, down_mm)
    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    ranges = {"normal_force_n": (0.1, 2.0), "frequency_hz": 4000}
    surface = haptix.FrictionSurface.build(model, ranges)

    def say(event: LayoutEvent) -> None:
        print(f"{event.kind} by finger {event.touch_id} at {event.x_mm:.1f}, {event.y_mm:.1f} mm")

    settings = LiveSettings(strict=False)
    opened = haptix.open_device(device)
    with screen, haptix.LiveRenderer(surface, layout, opened, settings=settings) as renderer:
        renderer.on("enter", say)
        renderer.on("leave", say)
        with suppress(KeyboardInterrupt):
            follow(renderer, screen, seconds)
    print(renderer.stats)
    print(renderer.touch_counts)


if __name__ == "__main__":
    try:
        typer.run(main)
    except (haptix.HaptixError, OSError) as error:
        sys.exit(f"touchscreen_photograph: {error}")
