"""A layout in forms of interchange, each as an archive of files with what it loses."""

from __future__ import annotations

import io
import json
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from haptix.errors import InputError

if TYPE_CHECKING:
    from haptix.materials import Material
    from haptix.surface import Column

FORMS = ("document", "friction-map", "wav", "ahap", "hjif")
SPEED_MM_S = 80.0
"""Of the stroke along which a form that knows no places is written."""
FORCE_N = 0.5
_MAP_COLUMNS = 1200
_STEP_MM = 0.25  # between corners of a line
_CORNERS_HZ = 1000.0  # skin feels no vibration above


def export(
    layout: Material,
    assets: Path,
    form: str,
    y_mm: float,
    reach: Callable[[], Column],
    opening: dict[str, Any],
) -> bytes:
    """Return an archive.

    Parameters
    ----------
    layout : Material
        Of the kind ``layout``.
    assets : Path
        Folder of its files.
    form : str
        One of `FORMS`. "document" keeps everything. "friction-map" is what a finger feels that goes
        right at time 0. The others are of one stroke to the right at 80 mm/s and 0.5 N.
    y_mm : float
        Height of that stroke.
    reach : callable
        Gives the reachable friction.
    opening : dict
        Finger and screen, for the volts of "wav".

    Raises
    ------
    InputError
        If the form is unknown, or cannot hold this layout.
    """
    if form not in FORMS:
        raise InputError(f"form: expected one of {', '.join(FORMS)}, got {form!r:.40}")
    left, right, top, bottom = layout.extent_mm
    if not right > left:
        raise InputError("layout: expected a region or more")
    with tempfile.TemporaryDirectory() as draft:
        folder = Path(draft)
        if form == "document":
            _document(layout, assets, folder)
        elif form == "friction-map":
            _friction_map(layout, folder, (left, right, top, bottom), reach())
        else:
            if not top <= y_mm <= bottom:
                raise InputError(f"y_mm: expected {top:g} to {bottom:g} mm, got {y_mm:g} mm")
            _line(layout, folder, form, (left, right), y_mm, reach, opening)
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            for path in sorted(one for one in folder.rglob("*") if one.is_file()):
                archive.write(path, path.relative_to(folder).as_posix())
        return packed.getvalue()


def _document(layout: Material, assets: Path, folder: Path) -> None:
    table = layout.model_dump(mode="json", exclude_none=True)
    text = json.dumps({"schema_version": 1, **table}, indent=2) + "\n"
    (folder / "layout.json").write_text(text)
    (folder / "assets").mkdir()
    for path in assets.iterdir():
        if path.stem in text:
            (folder / "assets" / path.name).write_bytes(path.read_bytes())


def _friction_map(
    layout: Material, folder: Path, box: tuple[float, float, float, float], column: Column
) -> None:
    from haptix.materials.picture import picture
    from haptix.stimuli.interchange import FrictionMap
    from haptix.texture import as_mu

    left, right, top, bottom = box
    wanted = picture(
        layout, right - left, bottom - top, _MAP_COLUMNS, corner_mm=(left, top)
    )  # fmt: skip
    low, high = float(column.lowest_mu), float(column.highest_mu)
    mu = as_mu(layout.evaluator.target, wanted, low, high)
    FrictionMap(np.clip(mu, low, high), right - left).save(folder / "friction-map.png")


def _line(
    layout: Material,
    folder: Path,
    form: str,
    ends_mm: tuple[float, float],
    y_mm: float,
    reach: Callable[[], Column],
    opening: dict[str, Any],
) -> None:
    from haptix.finger import Finger
    from haptix.motion import Motion
    from haptix.screen import Screen
    from haptix.signals.in_time import Points
    from haptix.stimuli import StimulusSet
    from haptix.stimuli.along_path import MaterialSignal
    from haptix.stimuli.along_path import Path as Along
    from haptix.stimuli.interchange import write_ahap, write_hjif
    from haptix.stimuli.stimulus import Stimulus
    from haptix.texture import as_mu

    left, right = ends_mm
    seconds = (right - left) / SPEED_MM_S
    if form == "hjif":
        x = np.linspace(left, right, max(2, round((right - left) / _STEP_MM)))
        motion = Motion.of(x, y_mm, (x - left) / SPEED_MM_S, SPEED_MM_S, normal_force_n=FORCE_N)
        low, high = float(reach().lowest_mu), float(reach().highest_mu)
        mu = np.clip(as_mu(layout.evaluator.target, layout.wanted(motion), low, high), low, high)
        lost = write_hjif(folder / "layout.hjif", (x - left).tolist(), mu.tolist())
        (folder / "lost.json").write_text(json.dumps(lost, indent=2) + "\n")
        return
    along = Along((0.0, seconds), (left, right))
    signal = MaterialSignal(layout, along, y_mm, FORCE_N, seconds)
    if form == "ahap":
        count = max(2, round(_CORNERS_HZ * seconds))
        shares = np.clip(signal.values(0, count, _CORNERS_HZ), 0.0, 1.0)
        corners = Points(tuple(np.arange(count) / _CORNERS_HZ), tuple(shares))
        lost = write_ahap(folder / "layout.ahap", corners, 0.0, 1.0)
        (folder / "lost.json").write_text(json.dumps(lost, indent=2) + "\n")
        return
    stimulus = Stimulus("layout", signal, "share", FORCE_N)
    finger, screen = Finger.named(opening["finger"]), Screen.named(opening["screen"])
    made = StimulusSet("layout", (stimulus,), finger, (screen,), unreachable="nearest")
    made.make(folder, threads=1)
