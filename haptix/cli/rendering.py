"""``haptix render`` and ``play``."""

from __future__ import annotations

import warnings
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from haptix.arguments import device_address, folder, number
from haptix.cli.options import (
    CarrierHz,
    DirectHz,
    FingerPath,
    HorizonMs,
    Image,
    MaterialFile,
    OwnFinger,
    OwnScreen,
    Range,
    ReactionMs,
    SurfaceFile,
    Waveform,
    Width,
    delay_ms,
)
from haptix.cli.setting import current_of, setting_of, surface_of
from haptix.errors import OverloadWarning
from haptix.terminal import AsJson, breakdown_note, placeholder_note, progress_bar, show

_ENDS_S = 0.05  # after the last touch: what it brought is heard


def render(
    out: Annotated[Path, typer.Option(help="Folder for the outputs.", callback=folder)] = Path(
        "haptix-render"
    ),
    image: Image = None,
    width_mm: Width = None,
    mu_range: Range = None,
    material: MaterialFile = None,
    trajectory: FingerPath = None,
    surface: SurfaceFile = None,
    finger: OwnFinger = None,
    screen: OwnScreen = None,
    carrier_hz: CarrierHz = None,
    direct_hz: DirectHz = None,
    waveform: Waveform = "sine",
    touch_hz: Annotated[
        float,
        typer.Option(
            help="Reports of the touch panel per second.", callback=number(least=1, most=10_000)
        ),
    ] = 100.0,
    touch_latency_ms: Annotated[
        float, typer.Option(help="Delay of its reports.", callback=delay_ms)
    ] = 20.0,
    reaction_ms: ReactionMs = 3.0,
    horizon_ms: HorizonMs = 100.0,
    device: Annotated[
        str, typer.Option(help="A mock device, with its options.", callback=device_address)
    ] = "mock:",
    as_json: AsJson = False,
) -> None:
    """Simulate live touches: a virtual finger feels what is played, and the error is split.

    Writes simulation.png, felt.csv, drive.wav with drive.json, and summary.json.
    """
    with progress_bar({"surface": "build the surface", "render": "play and feel"}) as update:
        update("surface", 0.0)
        from haptix.devices import open_device
        from haptix.files import check_folder
        from haptix.profiles import profiles_for
        from haptix.render import LiveSettings
        from haptix.simulation import FILES, errors_of, simulate, write
        from haptix.virtual_finger import TouchPanel

        check_folder(out, ("simulation.png", *FILES))
        # `simulate` refuses what is no mock; a mock may have another driver's serial number.
        with closing(open_device(device if device.startswith("mock:") else "mock:")) as opened:
            finger, screen = profiles_for(opened, finger, screen)
        setting, photograph = setting_of(
            image, width_mm, mu_range, trajectory, finger, screen, carrier_hz, direct_hz, waveform,
            material=material,
        )  # fmt: skip
        found = surface_of(setting, surface, partial(update, "surface"))
        simulation = simulate(
            setting,
            found,
            TouchPanel(touch_hz, touch_latency_ms / 1e3),
            LiveSettings(reaction_s=reaction_ms / 1e3, horizon_s=horizon_ms / 1e3),
            device,
            partial(update, "render"),
        )
        about = {
            "photograph": photograph,
            "finger": finger,
            "screen": screen,
            "touch_hz": touch_hz,
            "touch_latency_ms": touch_latency_ms,
            "reaction_ms": reaction_ms,
            "horizon_ms": horizon_ms,
        }
        summary = write(out, simulation, about)
    title = f"haptix render: outputs in {out}; {finger} finger on {screen}"
    title += f"; current {current_of(summary['current'])}"
    title += breakdown_note(summary["pull_past_breakdown"])
    title += placeholder_note(summary["placeholders"])
    show(title, [summary] if as_json else errors_of(simulation), as_json)


def play(
    image: Image = None,
    width_mm: Width = None,
    mu_range: Range = None,
    material: MaterialFile = None,
    trajectory: FingerPath = None,
    surface: SurfaceFile = None,
    finger: OwnFinger = None,
    screen: OwnScreen = None,
    carrier_hz: CarrierHz = None,
    direct_hz: DirectHz = None,
    waveform: Waveform = "sine",
    reaction_ms: ReactionMs = 3.0,
    horizon_ms: HorizonMs = 100.0,
    device: Annotated[
        str, typer.Option(help="Where to play, see `haptix devices`.", callback=device_address)
    ] = "mock:pace=real",
    as_json: AsJson = False,
) -> None:
    """Play a recorded path on a device, in real time."""
    with progress_bar({"surface": "build the surface", "play": "play"}) as update:
        update("surface", 0.0)
        from haptix.devices import open_device
        from haptix.profiles import profiles_for
        from haptix.render import LiveRenderer, LiveSettings
        from haptix.touch import events_of, paced

        with closing(open_device(device)) as opened:
            finger, screen = profiles_for(opened, finger, screen)
            setting, _ = setting_of(
                image, width_mm, mu_range, trajectory, finger, screen, carrier_hz, direct_hz,
                waveform, material=material,
            )  # fmt: skip
            found = surface_of(setting, surface, partial(update, "surface"))
            events = events_of(setting.path)
            # Not strict: after a stall of this machine, touches come too late to be of use.
            live = LiveSettings(
                reaction_s=reaction_ms / 1e3, horizon_s=horizon_ms / 1e3, strict=False
            )
            renderer = LiveRenderer(found, setting.texture, opened, setting.drive, live)
            with warnings.catch_warnings(), renderer:
                warnings.simplefilter("ignore", OverloadWarning)  # said below
                for number, event in enumerate(paced(events, clock=renderer.now_s), 1):
                    renderer.event(event)
                    update("play", number / len(events))
                renderer.run_until(renderer.now_s() + _ENDS_S)
    stats = renderer.stats
    row: dict[str, float | str] = {
        "seconds": stats.samples_played / renderer.sample_rate_hz,
        "reaction_ms": stats.reaction_s * 1e3,
        "underruns": stats.underruns,
        "block_p50_ms": stats.p50_block_s * 1e3,
        "block_p99_ms": stats.p99_block_s * 1e3,
        "too_low": stats.below / max(stats.samples, 1),
        "too_high": stats.above / max(stats.samples, 1),
    }
    title = f"haptix play: {device}"
    p50_ms, p99_ms = stats.reaction_p50_s * 1e3, stats.reaction_p99_s * 1e3
    if stats.revisions and not as_json:
        title += f"; reaction {p50_ms:.2g} ms (99 %: {p99_ms:.2g})"
    if as_json:
        row["advice"] = stats.advice
    if as_json and stats.revisions:
        row |= {"revisions": stats.revisions, "refused": stats.refused}
        row |= {"reaction_p50_ms": p50_ms, "reaction_p99_ms": p99_ms}
    show(f"{title}; {stats.advice}" if stats.advice else title, [row], as_json)
