"""``haptix demo``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from haptix.terminal import AsJson, progress_bar, show

_STAGES = {
    "surface": "solve the contact, build the surface",
    "render": "slide the finger, render, stream",
    "judge": "judge what was played",
    "write": "write figure, wave and summary",
}


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the outputs.")] = Path("haptix-demo"),
    image: Annotated[
        Path | None, typer.Option(help="Photograph. [default: a brick wall (CC0)]")
    ] = None,
    trajectory: Annotated[
        Path | None,
        typer.Option(help="CSV: t_s, x_mm, y_mm, normal_force_n. [default: one that ships]"),
    ] = None,
    width_mm: Annotated[float, typer.Option(help="Width of the photograph on the screen.")] = 60.0,
    polarity: Annotated[
        str, typer.Option(help="bright-high or dark-high: which grey has high friction.")
    ] = "bright-high",
    finger: Annotated[str, typer.Option(help="Finger preset: dry, semi-wet, wet.")] = "semi-wet",
    screen: Annotated[str, typer.Option(help="Screen preset.")] = "3m-sct3250",
    carrier_hz: Annotated[float, typer.Option(help="Frequency of the drive.")] = 4000.0,
    mu_range: Annotated[
        str | None,
        typer.Option(help="LOW,HIGH friction coefficients. [default: the reachable range]"),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """From a photograph to volts: the whole product once, without hardware.

    Writes demo.png, drive.wav with drive.json, and summary.json.
    """
    with progress_bar(_STAGES) as update:
        # torch and matplotlib load here: seconds that the bar should already cover.
        update("surface", 0.0)
        from haptix.cli.numbers import read_pair
        from haptix.demo import DemoJob

        wanted = None if mu_range is None else read_pair("mu-range", mu_range)
        job = DemoJob(
            out, image, trajectory, width_mm, polarity, finger, screen, carrier_hz, wanted
        )
        result = job.run(update)
    rows = [result.summary] if as_json else _rows(result.summary)
    show(f"haptix demo: outputs in {result.folder}", rows, as_json)


def _rows(summary: Mapping[str, Any]) -> list[dict[str, str]]:
    friction, range_, stream = summary["friction"], summary["out_of_range"], summary["stream"]
    surface, seconds = summary["surface"], summary["seconds"]
    origin = "from the cache" if surface["from_cache"] else "built"
    lines = {
        "photograph": f"{summary['photograph']}, {summary['width_mm']:g} mm wide",
        "contact": f"{summary['finger']} finger on {summary['screen']}; "
        f"stand-ins for the {' and the '.join(summary['stand_ins'])}",
        "surface": f"{origin} in {seconds['surface']:.2f} s, error in mu at most "
        f"{surface['error_max_mu']:.1g}",
        "wanted friction": f"{friction['target_mu_min']:.3f} to {friction['target_mu_max']:.3f}",
        "reached - wanted": _error(friction),
        "out of reach": f"{range_['share_below']:.1%} too low, {range_['share_above']:.1%} too "
        f"high, {range_['share_outside_surface']:.1%} outside the surface",
        "block times": f"median {stream['block_time_median_ms']:.2f} ms, 99 % below "
        f"{stream['block_time_p99_ms']:.2f} ms, for {stream['block_length_ms']:.2f} ms of signal",
        "stream": f"{stream['frames_sent']} frames, {stream['bytes_sent']} bytes, "
        f"{stream['underruns']} underruns, {stream['faults']} faults",
    }
    return [{"": name, "result": text} for name, text in lines.items()]


def _error(friction: Mapping[str, Any]) -> str:
    if friction["error_rms_mu"] is None:
        return "nothing that was wanted can be reached"
    return (
        f"rms {friction['error_rms_mu']:.1e}, 95 % below {friction['error_p95_mu']:.1e} in mu "
        f"({friction['error_p95_difference_thresholds']:.3f} of what can be felt), over the "
        f"{friction['share_judged']:.0%} that can be reached"
    )
