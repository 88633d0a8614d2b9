"""``haptix demo``."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from haptix.arguments import folder, one_of
from haptix.cli.options import Finger, FingerPath, Image, Range, Screen, positive, width
from haptix.cli.setting import current_of, setting_of
from haptix.report import row
from haptix.terminal import AsJson, breakdown_note, progress_bar, show

if TYPE_CHECKING:
    from haptix.virtual_finger import Evaluation


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the outputs.", callback=folder)] = Path(
        "haptix-demo"
    ),
    image: Image = None,
    trajectory: FingerPath = None,
    width_mm: Annotated[
        float, typer.Option(help="Width of the photograph on the screen.", callback=width)
    ] = 60.0,
    polarity: Annotated[
        str,
        typer.Option(
            help="bright-high or dark-high: which grey has high friction.",
            callback=one_of("bright-high", "dark-high"),
        ),
    ] = "bright-high",
    finger: Finger = "semi-wet",
    screen: Screen = "3m-sct3250",
    carrier_hz: Annotated[
        float, typer.Option(help="Frequency of the carrier.", callback=positive)
    ] = 4000.0,
    mu_range: Range = None,
    as_json: AsJson = False,
) -> None:
    """From a photograph to volts: everything once, without hardware.

    Writes demo.png, drive.wav with drive.json, felt.csv and summary.json.
    """
    stages = {
        "surface": "solve the contact, build the surface",
        "simulate": "slide the finger, render, play",
        "write": "write the files",
    }
    with progress_bar(stages) as update:
        # torch and matplotlib load here: the bar should already cover these seconds.
        update("surface", 0.0)
        from haptix.files import check_folder
        from haptix.simulation import FILES, simulate, write
        from haptix.texture import Texture

        check_folder(out, ("demo.png", *FILES))
        setting, photograph = setting_of(
            image, width_mm, mu_range, trajectory, finger, screen, carrier_hz, polarity=polarity
        )
        began_s = time.perf_counter()
        surface, was_cached = setting.surface(partial(update, "surface"))
        built_s = time.perf_counter()
        simulation = simulate(setting, surface, on_progress=partial(update, "simulate"))
        about = {
            "photograph": photograph,
            "width_mm": width_mm if isinstance(setting.texture, Texture) else None,
            "polarity": polarity,
            "finger": finger,
            "screen": screen,
            "is_surface_cached": was_cached,
            "seconds": {
                "surface": round(built_s - began_s, 3),
                "simulation": round(time.perf_counter() - built_s, 3),
            },
        }
        update("write", 0.0)
        summary = write(out, simulation, about, "demo.png")
    title = f"haptix demo: outputs in {out}{breakdown_note(summary['pull_past_breakdown'])}"
    show(title, [summary] if as_json else _rows(summary, simulation.evaluation), as_json)


def _rows(summary: Mapping[str, Any], errors: Evaluation) -> list[dict[str, str]]:
    shares, stream, surface = summary["out_of_range"], summary["stream"], summary["surface"]
    origin = "from the cache" if summary["is_surface_cached"] else "built"
    low, high = summary["target_mu"]
    width = "" if summary["width_mm"] is None else f", {summary['width_mm']:g} mm wide"
    lines = {
        "photograph": f"{summary['photograph']}{width}",
        "contact": f"{summary['finger']} finger on {summary['screen']}; placeholders: "
        f"{' and '.join(summary['placeholders'])}",
        "surface": f"{origin} in {summary['seconds']['surface']:.2f} s, error in mu at most "
        f"{surface['error_max_mu']:.1g}",
        "target friction": f"{low:.3f} to {high:.3f}",
        "error": ", ".join(f"{heading} {cell}" for heading, cell in row(errors).items()),
        "": errors.counts,
        "out of reach": f"{shares['share_below']:.1%} too low, {shares['share_above']:.1%} too "
        f"high, {shares['share_outside_surface']:.1%} outside the surface",
        "past breakdown": f"{summary['pull_past_breakdown']:.0%} of the attraction at its "
        "strongest, from gaps whose field is past what they bear",
        "current": current_of(summary["current"]),
        "block times": f"median {stream['block_p50_ms']:.2f} ms, 99 % below "
        f"{stream['block_p99_ms']:.2f} ms, for {stream['block_length_ms']:.2f} ms of signal",
        "stream": f"{stream['frames_sent']} frames, {stream['bytes_sent']} bytes, "
        f"{stream['underruns']} underruns, {stream['faults']} faults",
        "picture": summary["picture"],
    }
    return [{"": name, "result": text} for name, text in lines.items()]
