"""What a rehearsal leaves behind."""

from __future__ import annotations

import json
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import soundfile

from haptix.errors import InputError
from haptix.rehearsal.figure import draw
from haptix.rehearsal.rehearse import PARTS, Rehearsal
from haptix.texture import FrictionField
from haptix.virtual_finger import Verdict


def summary_of(rehearsal: Rehearsal) -> dict[str, Any]:
    """Verdict, its parts and the renderer's figures, as plain values."""
    stats = rehearsal.stats
    return {
        "verdict": _plain(rehearsal.verdict),
        "parts": {
            name: {"what": PARTS[name], **_plain(part)} for name, part in rehearsal.parts.items()
        },
        "renderer": {
            "samples": stats.samples,
            "below": stats.below,
            "above": stats.above,
            "outside": stats.outside,
            "block_p50_s": stats.p50_block_s,
            "block_p99_s": stats.p99_block_s,
            "block_max_s": stats.max_block_s,
        },
    }


def write(
    folder: Path, rehearsal: Rehearsal, texture: FrictionField, about: dict[str, Any]
) -> list[Path]:
    """Write rehearsal.png, summary.json, felt.csv and drive.wav: all of them, or none.

    Parameters
    ----------
    folder : Path
        Made if needed.
    about : dict
        What was rehearsed; goes into the summary.

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    felt = rehearsal.felt
    columns = {
        "t_s": felt.t_s,
        "x_mm": felt.x_mm,
        "y_mm": felt.y_mm,
        "normal_force_n": felt.normal_force_n,
        "wanted_mu": rehearsal.wanted_mu,
        "felt_mu": felt.mu,
        "is_reachable": rehearsal.is_reachable,
    }
    full_scale_v = max(float(np.abs(rehearsal.played_v).max(initial=0.0)), 1.0)
    about = {**about, "drive_full_scale_v": full_scale_v, "drive_start_s": rehearsal.start_s}

    def csv(file: Path) -> None:
        table = np.column_stack([np.asarray(column, dtype=float) for column in columns.values()])
        np.savetxt(file, table, "%.9g", ",", header=",".join(columns), comments="")

    def wave(file: Path) -> None:
        rate = round(rehearsal.sample_rate_hz)
        soundfile.write(file, rehearsal.played_v / full_scale_v, rate, "FLOAT", format="WAV")

    def summary(file: Path) -> None:
        text = json.dumps({**about, **summary_of(rehearsal)}, indent=2, allow_nan=False)
        file.write_text(text + "\n", encoding="utf-8")

    writers = {
        "rehearsal.png": lambda file: draw(file, rehearsal, texture),
        "felt.csv": csv,
        "drive.wav": wave,
        "summary.json": summary,
    }
    drafts = {folder / name: folder / f".draft-{name}" for name in writers}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        try:
            for draft, writer in zip(drafts.values(), writers.values(), strict=True):
                writer(draft)
            for file, draft in drafts.items():
                draft.replace(file)
        finally:
            for draft in drafts.values():
                draft.unlink(missing_ok=True)
    except (OSError, soundfile.SoundFileError) as error:
        raise InputError(f"--out: cannot write to {folder}: {error}") from None
    return list(drafts)


def _plain(verdict: Verdict) -> dict[str, Any]:
    return {
        name: None if isinstance(value, float) and not isfinite(value) else value
        for name, value in asdict(verdict).items()
    }
