"""Layouts, exported in formats of other programs; each archive says what is lost."""

from __future__ import annotations

import io
import json
import tempfile
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from haptix.desk import Context, Result, Task
from haptix.errors import InputError
from haptix.fields import FingerName, ForClients, JsonObject, Local, Range, ScreenName

if TYPE_CHECKING:
    from haptix.materials import Material

SPEED_MM_S = 80.0
"""Force and speed of the stroke along which a format without places is written."""
FORCE_N = 0.5
_MAP_COLUMNS = 1200
_STEP_MM = 0.25  # between corners of a line
_CORNERS_HZ = 1000.0  # above this, skin feels no vibration


class ExportLayout(Task):
    """Export a layout in a format of other programs: a zip archive that says what is lost.

    "document" keeps everything. "friction-map" is the friction under a finger that moves right at
    time 0. The others are one stroke to the right at 80 mm/s and 0.5 N.
    """

    document: Annotated[JsonObject, ForClients()] = Field(
        description="A layout, as `layout_set` takes it."
    )
    form: Literal["document", "friction-map", "wav", "ahap", "hjif"]
    y_mm: Annotated[float, Field(ge=-1e4, le=1e4)] = Field(
        0.0, description="Height of the stroke, for formats without places."
    )
    reachable_mu: Annotated[Range, Local()]
    finger: Annotated[FingerName, Local()]
    screen: Annotated[ScreenName, Local()]

    def run(self, context: Context) -> Result:
        """Pack the files of the form; the layout's own are in the context's folder."""
        from haptix.materials import material_of

        layout = material_of(self.document)
        left, right, top, bottom = layout.extent_mm
        if not right > left:
            raise InputError("layout: expected at least one region")
        with tempfile.TemporaryDirectory() as draft:
            folder = Path(draft)
            if self.form == "document":
                assert context.folder is not None
                _document(layout, context.folder, folder)
            elif self.form == "friction-map":
                self._friction_map(layout, folder)
            else:
                if not top <= self.y_mm <= bottom:
                    raise InputError(
                        f"y_mm: expected {top:g} to {bottom:g} mm, got {self.y_mm:g} mm"
                    )
                self._line(layout, folder)
            packed = io.BytesIO()
            with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
                for path in sorted(path for path in folder.rglob("*") if path.is_file()):
                    name = zipfile.ZipInfo(path.relative_to(folder).as_posix())  # without a time
                    archive.writestr(name, path.read_bytes(), zipfile.ZIP_DEFLATED)
        return Result({"form": self.form}, files={"layout.zip": packed.getvalue()})

    def _friction_map(self, layout: Material, folder: Path) -> None:
        import numpy as np

        from haptix.materials.picture import picture
        from haptix.stimuli.interchange import FrictionMap
        from haptix.texture import as_mu

        left, right, top, bottom = layout.extent_mm
        width_mm = right - left
        wanted = picture(layout, width_mm, bottom - top, _MAP_COLUMNS, corner_mm=(left, top))
        mu = as_mu(layout.evaluator.target, wanted, *self.reachable_mu)
        FrictionMap(np.clip(mu, *self.reachable_mu), width_mm).save(folder / "friction-map.png")

    def _line(self, layout: Material, folder: Path) -> None:
        import numpy as np

        from haptix.finger import Finger
        from haptix.motion import Motion
        from haptix.screen import Screen
        from haptix.signals.shapes import Points
        from haptix.stimuli import StimulusSet
        from haptix.stimuli.along_path import MaterialSignal
        from haptix.stimuli.along_path import Path as Along
        from haptix.stimuli.interchange import write_ahap, write_hjif
        from haptix.stimuli.stimulus import Stimulus
        from haptix.texture import as_mu

        left, right, _, _ = layout.extent_mm
        seconds = (right - left) / SPEED_MM_S
        along = Along((0.0, seconds), (left, right))
        signal = MaterialSignal(layout, along, self.y_mm, FORCE_N, seconds)
        if self.form == "wav":
            stimulus = Stimulus("layout", signal, "share", FORCE_N)
            screens = (Screen.named(self.screen),)
            stimuli = StimulusSet(
                "layout", (stimulus,), Finger.named(self.finger), screens, unreachable="nearest"
            )
            stimuli.make(folder, threads=1)
            return
        if self.form == "hjif":
            x = np.linspace(left, right, max(2, round((right - left) / _STEP_MM)))
            motion = Motion.of(
                x, self.y_mm, (x - left) / SPEED_MM_S, SPEED_MM_S, normal_force_n=FORCE_N
            )
            low_high = self.reachable_mu
            mu = as_mu(layout.evaluator.target, layout.wanted(motion), *low_high)
            mu = np.clip(mu, *low_high)
            lost = write_hjif(folder / "layout.hjif", (x - left).tolist(), mu.tolist())
        else:
            count = max(2, round(_CORNERS_HZ * seconds))
            shares = np.clip(signal.values(0, count, _CORNERS_HZ), 0.0, 1.0)
            corners = Points(tuple(np.arange(count) / _CORNERS_HZ), tuple(shares))
            lost = write_ahap(folder / "layout.ahap", corners, 0.0, 1.0)
        (folder / "lost.json").write_text(json.dumps(lost, indent=2) + "\n")


def _document(layout: Material, assets: Path, folder: Path) -> None:
    table = layout.model_dump(mode="json", exclude_none=True)
    text = json.dumps({"schema_version": 1, **table}, indent=2) + "\n"
    (folder / "layout.json").write_text(text)
    (folder / "assets").mkdir()
    for path in assets.iterdir():
        if path.stem in text:
            (folder / "assets" / path.name).write_bytes(path.read_bytes())
