"""The files that a simulation writes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

import soundfile

from firmware_io import volts_to_codes
from firmware_io.limits import Current
from haptix.errors import MissingExtraError
from haptix.files import check_folder, csv_text, json_text, write_folder
from haptix.pair import described
from haptix.render import SineCarrier
from haptix.report import record, row
from haptix.simulation.simulation import PARTS, Simulation
from haptix.version import __version__

_PERIODS = "of the modulation: mean friction of each period of the drive; the rest is ripple"

FILES = ("felt.csv", "drive.wav", "drive.json", "summary.json")
"""Files that `write` makes besides the picture."""


def summary_of(simulation: Simulation) -> dict[str, Any]:
    """Evaluation, parts of the error and counts, as plain values."""
    played, info = simulation.played, simulation.surface.info
    stats, device, driver = played.renderer.stats, played.device, played.device.mock
    assert driver is not None
    rendered_s = stats.samples / played.renderer.sample_rate_hz
    target, model = simulation.target_mu, simulation.setting.model
    return {
        "haptix": __version__,
        **described(model.finger, model.screen),
        "placeholders": model.placeholders(),
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


def errors_of(simulation: Simulation) -> list[dict[str, str]]:
    """Return the parts of the error, that of the periods and all errors, as rows for people."""
    errors = {**simulation.parts, "periods": simulation.periods, "all": simulation.evaluation}
    about = {**PARTS, "periods": _PERIODS}
    return [
        {"error": name, **row(one), "what": about.get(name, one.counts)}
        for name, one in errors.items()
        if one is not None
    ]


def write(
    folder: Path, simulation: Simulation, about: Mapping[str, Any], picture: str = "simulation.png"
) -> dict[str, Any]:
    """Write a picture and `FILES`: all of them, or none.

    Parameters
    ----------
    folder : Path
        Folder of the files, made if needed.
    simulation : Simulation
        Simulation to write.
    about : mapping of str
        What was simulated, in words; goes into the summary.
    picture : str
        Name of the picture, which needs the extra ``figures`` and is left out without it.

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
        from haptix.simulation.figure import draw  # matplotlib takes half a second
    except MissingExtraError as error:
        pictured = f"not drawn: {error}"
    else:
        drawn, pictured = {picture: partial(draw, simulation)}, picture
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
    """Return the codes that went over the wire as a WAV file: it is what was played."""
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
    """Current through the person that the played drive makes, and its limits."""
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
