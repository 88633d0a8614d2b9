"""The files that a simulation writes, and its picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from io import BytesIO
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import soundfile
import torch

from firmware_io import volts_to_codes
from firmware_io.limits import Current
from haptix.base.errors import MissingExtraError, from_extra
from haptix.base.fields import LIFTED_BELOW_N
from haptix.base.files import check_folder, csv_text, json_text, write_folder
from haptix.base.report import record, row
from haptix.base.version import __version__
from haptix.feel.materials import Texture
from haptix.feel.motion import Motion
from haptix.model.contact import Accuracy
from haptix.model.pair import described
from haptix.model.perception.thresholds import WEBER_FRACTION
from haptix.play.render import SineCarrier
from haptix.play.simulation.run import PARTS, Simulation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PERIODS = "of the modulation: mean friction of each period of the drive; the rest is ripple"

_MOST = (5, 95)  # percentiles: each path starts and ends at rest

_DRAWN_MM_PER_S = 50.0  # what depends on the motion is drawn for a finger that moves to the right
_PIXELS = 400  # across the texture
_MARGIN_MM = 2.0  # around the path, on a texture without edges
_ZOOM_S = 0.006
_ZOOM_PERIODS = 10

FILES = ("felt.csv", "drive.wav", "drive.json", "summary.json")
"""Files that `write` makes besides the picture."""


def summary_of(simulation: Simulation) -> dict[str, Any]:
    """Evaluation, parts of the error and counts, as plain values."""
    played, info = simulation.played, simulation.surface.info
    stats, device, driver = played.renderer.stats, played.device, played.device.mock
    assert driver is not None
    rendered_s = stats.samples / played.renderer.sample_rate_hz
    target, model = simulation.target_mu, simulation.setting.model
    strongest = simulation.at_strongest
    return {
        "haptix": __version__,
        **described(model.finger, model.screen),
        "placeholders": model.placeholders(),
        "beyond_verified": _beyond_verified(simulation),
        "target_mu": [float(target.min()), float(target.max())],
        "evaluation": record(simulation.evaluation),
        "parts": {
            name: {"what": PARTS[name], **record(part)} for name, part in simulation.parts.items()
        },
        "periods": simulation.periods and {"what": _PERIODS, **record(simulation.periods)},
        "out_of_range": {
            "share_below": stats.below / stats.samples,
            "share_above": stats.above / stats.samples,
            "share_outside_surface": stats.outside / stats.samples,
        },
        "surface": {
            "grid": list(simulation.surface.mu_table.shape),
            "error_max_mu": info.get("error_max"),
            "error_p99_mu": info.get("error_p99"),
            "key": info["key"],
        },
        "pull_past_breakdown": simulation.pull_past_breakdown,
        "accuracy": None if strongest is None else strongest.accuracy.record(),
        "current": _current(simulation),
        "stream": {
            "blocks": len(stats.block_s),
            "block_length_ms": 1e3 * rendered_s / len(stats.block_s),
            "block_p50_ms": stats.p50_block_s * 1e3,
            "block_p99_ms": stats.p99_block_s * 1e3,
            "block_max_ms": stats.max_block_s * 1e3,
            "frames_sent": device.frames_sent,
            "bytes_sent": device.bytes_sent,
            "samples_played": driver.samples_played,
            "underruns": driver.underruns,
            "faults": driver.faults,
        },
    }


def _beyond_verified(simulation: Simulation) -> list[str]:
    """Return what of path and drive the screen's calibration has not verified, but for 5 %."""
    verified = simulation.setting.model.screen.verified
    if verified is None:
        return []
    path = simulation.setting.path
    touching = path.normal_force_n >= LIFTED_BELOW_N
    way_mm = np.hypot(np.gradient(path.x_mm), np.gradient(path.y_mm))
    return verified.beyond(
        np.percentile(path.normal_force_n[touching], _MOST),
        np.abs(simulation.played.drive_v).max(initial=0.0),
        simulation.setting.frequency_hz,
        np.percentile((way_mm / np.gradient(path.t_s))[touching], _MOST),
    )


def errors_of(simulation: Simulation) -> list[dict[str, str]]:
    """Return the parts of the error, that of the periods and all errors, as rows for people."""
    errors = {**simulation.parts, "periods": simulation.periods, "all": simulation.evaluation}
    about = {**PARTS, "periods": _PERIODS}
    rows = [
        {"error": name, **row(evaluation), "what": about.get(name, evaluation.counts)}
        for name, evaluation in errors.items()
        if evaluation is not None
    ]
    strongest = simulation.at_strongest
    if strongest is not None:  # the finger that feels has the same theory: no part shows it
        none = dict.fromkeys(row(simulation.evaluation), "-")
        rows.append({"error": "theory", **none, "what": _theory(strongest.accuracy)})
    return rows


def _theory(accuracy: Accuracy) -> str:
    """Return the theory's own interval in words; it adds to all errors."""
    parts = []
    for what, width in (("friction", accuracy.mu), ("mu(V)/mu(0)", accuracy.ratio)):
        jnd = float(torch.expm1(width.max())) / WEBER_FRACTION
        parts.append(f"{jnd:.2g} JND of {what}" if jnd < inf else f"of {what} not shown there")
    return f"its own 90 % interval at the strongest drives: {', '.join(parts)}"


def write(
    folder: Path,
    simulation: Simulation,
    about: Mapping[str, Any],
    picture: str = "simulation.png",
    panels: Literal[2, 5] = 5,
) -> dict[str, Any]:
    """Write a picture and `FILES`: all of them, or none.

    Parameters
    ----------
    folder : Path
        Folder of the files, made if needed.
    simulation : Simulation
        Simulation to write.
    about : mapping of str
        Name of the simulation; goes into the summary.
    picture : str
        Name of the picture, which needs the extra ``figures`` and is left out without it.
    panels : int
        2 for texture and friction, 5 for force, voltage and wave as well.

    Returns
    -------
    dict
        What summary.json holds.

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    check_folder(folder, (picture, *FILES))
    drawn: dict[str, Any] = {}
    try:
        with from_extra("figures"):
            import matplotlib.figure  # noqa: F401  # half a second
    except MissingExtraError as error:
        pictured = f"not drawn: {error}"
    else:
        drawn, pictured = {picture: partial(draw, simulation, panels=panels)}, picture
    summary = {**about, **summary_of(simulation), "picture": pictured}
    contents = (
        _felt_table(simulation),
        _wave(simulation),
        json_text(_sidecar(simulation)),
        json_text(summary),
    )
    write_folder(folder, {**drawn, **dict(zip(FILES, contents, strict=True))})
    return summary


def _felt_table(simulation: Simulation) -> str:
    felt = simulation.felt
    columns = {
        "t_s": felt.t_s,
        "x_mm": felt.x_mm,
        "y_mm": felt.y_mm,
        "normal_force_n": felt.normal_force_n,
        "target_mu": simulation.target_mu,
        "felt_mu": felt.mu,
        "is_reachable": simulation.is_reachable.astype(int),
    }
    return csv_text(columns, zip(*(c.tolist() for c in columns.values()), strict=True), digits=9)


def _wave(simulation: Simulation) -> bytes:
    """Return the codes that went over the wire, which were played, as a WAV file."""
    played, file = simulation.played, BytesIO()
    rate = round(played.renderer.sample_rate_hz)
    codes = volts_to_codes(played.drive_v, played.device.capabilities.full_scale_v)
    soundfile.write(file, codes, rate, "PCM_16", format="WAV")
    return file.getvalue()


def _sidecar(simulation: Simulation) -> dict[str, Any]:
    played = simulation.played
    drive = played.renderer.drive
    frequency = "carrier_hz" if isinstance(drive, SineCarrier) else "direct_hz"
    return {
        "what": "drive signal as the mock driver played it",
        "volts": "sample / 32767 * full_scale_v",
        "full_scale_v": played.device.capabilities.full_scale_v,
        "sample_rate_hz": played.renderer.sample_rate_hz,
        "start_s": played.start_s,
        frequency: drive.frequency_hz,
        "voltage_limit_v": simulation.surface.voltage_limit_v,
        "expected_current": _current(simulation),
        "pull_past_breakdown": simulation.pull_past_breakdown,
        "surface_key": simulation.surface.info["key"],
        "model": simulation.setting.model.describe(),
    }


def _current(simulation: Simulation) -> dict[str, float]:
    """Return the current that the played drive sends through the person, and its limits."""
    played, limits = simulation.played, simulation.played.device.limits
    expected = Current.of_drive(
        played.drive_v, played.renderer.sample_rate_hz, limits.capacitance_f
    )
    return {
        **asdict(expected),
        "capacitance_f": limits.capacitance_f,
        "limit_peak_a": limits.max_peak_a,
        "limit_rms_a": limits.max_rms_a,
    }


def draw(simulation: Simulation, file: Path, panels: Literal[2, 5] = 5) -> None:
    """Draw path and texture, friction, voltage, and the waveform or the parts of the error."""
    from matplotlib.figure import Figure

    if panels == 2:
        figure = Figure(figsize=(8, 8), layout="constrained")
        above, below = figure.subplots(2, height_ratios=(1.4, 1))
        _texture(above, simulation)
        above.set_title("Bright is to feel rougher; a finger slides from red to yellow")
        _friction(below, simulation)
        below.set(xlabel="time (s)", title="Friction that is asked for, and that the finger feels")
        figure.savefig(file, dpi=110, format="png")
        return
    figure = Figure(figsize=(13, 8.5), layout="constrained")
    grid = figure.add_gridspec(3, 2, width_ratios=(1, 1.5), height_ratios=(1.15, 1, 1))
    _texture(figure.add_subplot(grid[:2, 0]), simulation)
    _force_and_speed(figure.add_subplot(grid[2, 0]), simulation)
    friction = figure.add_subplot(grid[0, 1])
    _friction(friction, simulation)
    voltage = figure.add_subplot(grid[1, 1], sharex=friction)
    _voltage(voltage, simulation)
    last = figure.add_subplot(grid[2, 1])
    if simulation.parts:
        _parts(last, simulation)
    else:
        _zoom(last, voltage, simulation)
    figure.suptitle("haptix: from a texture to volts", fontsize=14)
    figure.savefig(file, dpi=110, format="png")


def _texture(axes: Axes, simulation: Simulation) -> None:
    felt, texture = simulation.felt, simulation.setting.texture
    if isinstance(texture, Texture):
        left, right, top, bottom = 0.0, texture.width_mm, 0.0, texture.height_mm
    else:
        left, right = float(felt.x_mm.min()) - _MARGIN_MM, float(felt.x_mm.max()) + _MARGIN_MM
        top, bottom = float(felt.y_mm.min()) - _MARGIN_MM, float(felt.y_mm.max()) + _MARGIN_MM
    pixel_mm = (right - left) / _PIXELS
    rows = max(2, round((bottom - top) / pixel_mm))
    x, y = np.meshgrid(np.linspace(left, right, _PIXELS), np.linspace(top, bottom, rows))
    to_the_right = Motion.of(x, y, 0.0, _DRAWN_MM_PER_S, 0.0, footprint_mm=pixel_mm)
    target = texture.evaluator.wanted(to_the_right).reshape(x.shape)
    axes.imshow(target, cmap="gray", extent=(left, right, bottom, top))
    points = axes.scatter(felt.x_mm, felt.y_mm, c=felt.t_s - felt.t_s[0], s=4, cmap="autumn")
    start = (float(felt.x_mm[0]), float(felt.y_mm[0]))
    axes.plot(*start, "o", ms=11, mfc="none", mec="tab:blue", mew=2.5)
    axes.annotate(
        "start",
        start,
        (-6, 12),
        textcoords="offset points",
        color="white",
        fontweight="bold",
        bbox={"facecolor": "tab:blue", "edgecolor": "none", "pad": 1.5},
    )
    axes.figure.colorbar(points, ax=axes, label="time (s)", shrink=0.7)
    axes.set(
        xlabel="x on the screen (mm)",
        ylabel="y (mm)",
        title="1  Texture (bright = high friction)\nand path of the finger, from red to yellow",
    )


def _force_and_speed(axes: Axes, simulation: Simulation) -> None:
    felt = simulation.felt
    t = felt.t_s - felt.t_s[0]
    axes.plot(t, felt.normal_force_n, color="tab:green")
    axes.set_ylabel("normal force (N)", color="tab:green")
    axes.set(ylim=(0, None), xlabel="time (s)", title="2  The finger's force and speed")
    speed = axes.twinx()
    speed.plot(t, felt.speed_mm_per_s, color="0.4", ls="--")
    speed.set_ylabel("speed (mm/s), dashed", color="0.4")
    speed.set_ylim(0, None)


def _friction(axes: Axes, simulation: Simulation) -> None:
    simulation.plot(axes).set(
        xlabel="", title="3  Friction under the finger, which also depends on its force"
    )


def _voltage(axes: Axes, simulation: Simulation) -> None:
    played, limit = simulation.played, simulation.surface.voltage_limit_v
    volts = played.drive_v
    t = played.start_s + np.arange(len(volts)) / played.renderer.sample_rate_hz
    axes.plot(t, volts, color="tab:purple", lw=0.3)
    axes.axhline(limit, color="0.5", ls=":", lw=1)
    axes.text(simulation.felt.t_s[0], limit, "limit of the screen", va="bottom")
    axes.set(
        ylabel="played (V)",
        ylim=(-1.15 * limit, 1.25 * limit),
        xlabel="time (s)",
        title="4  Voltage that was played",
    )


def _parts(axes: Axes, simulation: Simulation) -> None:
    errors = {**simulation.parts, "all": simulation.evaluation}
    p95 = np.nan_to_num([error.error_p95_jnd for error in errors.values()])
    axes.barh(list(errors), p95, color=["tab:blue"] * len(simulation.parts) + ["0.4"])
    axes.axvline(1.0, color="0.5", ls=":", lw=1)
    axes.invert_yaxis()
    axes.set(
        xscale="log",
        xlim=(1e-4, 10.0),
        xlabel="95 % of errors are below (JND)",
        title="5  Parts of the error",
    )


def _zoom(axes: Axes, voltage: Axes, simulation: Simulation) -> None:
    """Draw the liveliest stretch of the wave, and mark it in the voltage."""
    played = simulation.played
    volts, rate = played.drive_v, played.renderer.sample_rate_hz
    seconds = max(_ZOOM_S, _ZOOM_PERIODS / played.renderer.drive.frequency_hz)
    count = min(round(seconds * rate), len(volts))
    # The window whose halves differ most in amplitude.
    peaks = np.abs(volts[: len(volts) // count * count]).reshape(-1, count)
    change = np.abs(peaks[:, : count // 2].max(1) - peaks[:, count // 2 :].max(1))
    first = int(change.argmax()) * count
    t = played.start_s + np.arange(first, first + count) / rate
    voltage.axvspan(t[0] - 0.01, t[-1] + 0.01, color="tab:orange", alpha=0.5)
    top = 0.92 * simulation.surface.voltage_limit_v
    voltage.annotate("5", (t[0], top), (5, 0), textcoords="offset points", fontweight="bold")
    axes.plot(t * 1e3, volts[first : first + count], color="tab:purple", lw=1, marker=".", ms=3)
    axes.set(
        xlabel="time (ms)",
        ylabel="played (V)",
        title="5  The wave that was played, sample by sample: the band in 4",
    )
