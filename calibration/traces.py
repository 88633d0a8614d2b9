"""Raw traces of all strokes for the report: one small drawing each, opened by a click."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from calibration.parameters import Array
from calibration.recording import StrokeRecording
from calibration.segmentation import full_slip

_WIDTH, _HEIGHT = 900, 190
_COLUMNS = 300  # each with the lowest and the highest sample in it
_COLOURS = {"normal force [N]": "#1f5fa8", "tangential force [N]": "#c9541c", "x": "#a6761d"}


def traces(recordings: Sequence[StrokeRecording], opened: int | None = None) -> str:
    """HTML with both forces and the place of each stroke over time, full slip shaded.

    The stroke of number `opened` is shown, the others open by a click; no script is needed.
    """
    if not recordings:
        return ""
    keys = " ".join(
        f'<span style="color:{colour}">{escape(name)}</span>' for name, colour in _COLOURS.items()
    )
    parts = [
        "<h2>Raw traces</h2><p>Full slip, which alone counts, is shaded; the stroke farthest from "
        f"the fit is open. {keys}</p>"
    ]
    for one in recordings:
        is_open = " open" if one.stroke.number == opened else ""
        parts.append(
            f"<details{is_open}><summary>{escape(one.stroke.label)}</summary>{_drawn(one)}</details>"
        )
    return "".join(parts)


def _drawn(recording: StrokeRecording) -> str:
    t = recording.t_s - recording.t_s[0]
    across = t / max(float(t[-1]), 1e-9) * _WIDTH
    forces = recording.normal_force_n, recording.tangential_force_n
    low, high = min(one.min() for one in forces), max(one.max() for one in forces)
    place = recording.x_mm
    lines = [(one, low, high) for one in forces] + [(place, place.min(), place.max())]
    shaded = "".join(
        f'<rect x="{across[s.start]:.1f}" y="0" width="{across[s.stop - 1] - across[s.start]:.1f}" '
        f'height="{_HEIGHT}" fill="#1b9e77" opacity="0.15"/>'
        for s in full_slip(recording.t_s, place, recording.normal_force_n)
    )
    drawn = "".join(
        f'<polyline fill="none" stroke="{colour}" points="{_points(across, *line)}"/>'
        for line, colour in zip(lines, _COLOURS.values(), strict=True)
    )
    zero = _HEIGHT * (1 - (0 - low) / max(high - low, 1e-9))
    return (
        f'<svg role="img" aria-label="raw trace of stroke {recording.stroke.number}" '
        f'viewBox="0 0 {_WIDTH} {_HEIGHT + 16}">{shaded}'
        f'<line x1="0" x2="{_WIDTH}" y1="{zero:.1f}" y2="{zero:.1f}" stroke="#999"/>{drawn}'
        f'<text x="2" y="12" font-size="12">{high:.3g} N</text>'
        f'<text x="2" y="{_HEIGHT - 2}" font-size="12">{low:.3g} N</text>'
        f'<text x="{_WIDTH - 2}" y="{_HEIGHT + 13}" font-size="12" text-anchor="end">'
        f"{t[-1]:.2f} s</text></svg>"
    )


def _points(across: Array, values: Array, low: float, high: float) -> str:
    """Points of a line: of each column of samples the lowest and the highest."""
    up = _HEIGHT * (1 - (values - low) / max(high - low, 1e-9))
    edges = np.linspace(0, len(up), min(_COLUMNS, len(up)) + 1).astype(int)[:-1]
    ends = np.minimum.reduceat(up, edges), np.maximum.reduceat(up, edges)
    pairs = zip(across[edges], *ends, strict=True)
    return " ".join(f"{x:.1f},{a:.1f} {x:.1f},{b:.1f}" for x, a, b in pairs)
