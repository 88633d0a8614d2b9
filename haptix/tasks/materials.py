"""Tasks of materials, the documents of how a surface feels."""

from __future__ import annotations

import io
import json
import tempfile
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from haptix.base.errors import InputError
from haptix.base.fields import (
    Argument,
    FileThere,
    ForClients,
    JsonObject,
    Local,
    MaterialFile,
    NewDocument,
    NewPicture,
    Range,
    Seed,
    refuse_input,
)
from haptix.base.task import Context, Result, Task
from haptix.model.presets import FingerName, ScreenName

if TYPE_CHECKING:
    from haptix.feel.materials import Material


class ShowMaterial(Task, command="material show"):
    """Draw a material: its friction by place, direction, speed, force and time."""

    file: Annotated[MaterialFile, Argument] = Field(
        description="Material: TOML or JSON, or gallery:NAME."
    )
    out: NewPicture | None = Field(None, description="Picture. [default: FILE with .png]")

    def run(self, context: Context) -> Result:
        """Write the picture."""
        from haptix.base.files import write_whole
        from haptix.feel.gallery import load
        from haptix.feel.materials import draw

        material = load(self.file)
        name = self.file.name.removeprefix("gallery:")
        out = self.out or self.file.with_name(name).with_suffix(".png")
        refuse_input(out, self.file)
        figure = draw(material)
        write_whole(out, lambda draft: figure.savefig(draft, format="png", dpi=70))
        evaluator = material.evaluator
        row = {
            "kind": material.kind,
            "target": evaluator.target,
            "depends_on": ", ".join(str(flag.name).lower() for flag in evaluator.depends_on),
            "picture": str(out),
        }
        return Result([row], [(f"haptix material: {self.file}", [row])])


class ListKinds(Task, command="material kinds"):
    """List the kinds of materials with their fields."""

    def run(self, context: Context) -> Result:
        """List them."""
        from haptix.feel.materials import KINDS

        rows: list[dict[str, Any]] = []
        for name, kind in sorted(KINDS.items()):
            fields = {
                key: "required" if field.is_required() else str(field.default)
                for key, field in kind.model_fields.items()
                if key != "kind"
            }
            about = (kind.__doc__ or "").strip().split("\n")[0]
            rows.append({"kind": name, "what": about, "fields": fields})
        shown = [{**row, "fields": _listed(row["fields"])} for row in rows]
        return Result(rows, [("kinds of materials", shown)])


def _listed(fields: dict[str, str]) -> str:
    return ", ".join(
        name if default in ("required", "None") else f"{name}={default}"
        for name, default in fields.items()
    )


class ListGallery(Task, command="material gallery"):
    """List the presets of the gallery, which ``gallery:NAME`` names."""

    def run(self, context: Context) -> Result:
        """List them."""
        from haptix.feel.gallery import presets

        rows = [
            {
                "name": preset.name,
                "family": preset.family,
                "kind": preset.document["kind"],
                "what": preset.help,
            }
            for preset in presets()
        ]
        return Result(rows, [("presets of materials", rows)])


class PrintSchema(Task, command="material schema"):
    """Print the JSON Schema of all materials."""

    def run(self, context: Context) -> Result:
        """Print it."""
        from haptix.feel.materials import schema

        document = schema()
        return Result(document, lines=[json.dumps(document, indent=2)])


class FitMaterial(Task, command="material fit"):
    """Fit a compact material to a recording of friction in time, and compare what both give.

    The virtual finger feels both at 20 to 100 mm/s and 0.2 to 0.8 N; rows say in which of nine
    bands between 10 and 1000 Hz the levels are within 1 dB, and where they are not.
    """

    recording: Annotated[FileThere, Argument] = Field(
        description="CSV with t_s, position_mm or speed_mm_per_s, and mu or tangential_force_n "
        "with normal_force_n."
    )
    columns: FileThere | None = Field(
        None, description="Which column of another recording is what, as TOML."
    )
    out: NewDocument | None = Field(None, description="Material. [default: RECORDING with .toml]")
    finger: FingerName = Field("semi-wet", description="Finger that feels both.")
    screen: ScreenName = Field("3m-sct3250", description="Screen.")
    seed: Seed = Field(0, description="Seed of the pattern.")

    def run(self, context: Context) -> Result:
        """Fit, write and compare."""
        import tomlkit

        from haptix.base.files import write_whole
        from haptix.feel.materials.recording_columns import RecordingColumns
        from haptix.feel.materials.spectral import fit, stretches
        from haptix.model.finger import Finger
        from haptix.model.friction import ContactModel
        from haptix.model.screen import Screen
        from haptix.play.simulation.run import WITHIN_DB, band_name, felt_errors

        out = self.out or self.recording.with_suffix(".toml")
        refuse_input(out, self.recording)
        columns = None if self.columns is None else RecordingColumns.load(self.columns)
        recorded = stretches(self.recording, columns)
        material = fit(recorded, self.seed)
        fields = {"kind": material.kind, **material.model_dump(exclude_defaults=True)}
        text = tomlkit.dumps(fields)
        write_whole(out, text)
        model = ContactModel(Finger.named(self.finger), Screen.named(self.screen))
        cases = [*felt_errors(model, material, recorded, lambda s: context.progress("feel", s))]
        rows: list[dict[str, Any]] = []
        for band in sorted({case.band for case in cases}):
            of_band = [case for case in cases if case.band == band]
            worst = max(of_band, key=lambda case: abs(case.error_db))
            rows.append(
                {
                    "band": band_name(band),
                    "recorded_db": round(sum(c.recorded_db for c in of_band) / len(of_band), 1),
                    "within": f"{sum(case.is_near for case in of_band)} of {len(of_band)}",
                    "worst_db": round(worst.error_db, 2),
                    "at": f"{worst.speed_mm_per_s:g} mm/s, {worst.normal_force_n:g} N",
                }
            )
        share = sum(case.is_near for case in cases) / len(cases) if cases else 0.0
        missing = [band_name(band) for band in range(9) if band not in {c.band for c in cases}]
        title = (
            f"{out}: {len(text.encode())} bytes; of {len(recorded)} strokes "
            f"({max(stroke.length_mm for stroke in recorded):.0f} mm the longest); felt within "
            f"{WITHIN_DB:g} dB in {share:.0%} of {len(cases)} cases"
        )
        if missing:
            title += f"; not recorded: {', '.join(missing)}"
        return Result(rows, [(title, rows)])


class CompareMaterials(Task, command="material distance"):
    """Distance of two textures [dB]: recordings in time, or materials of mu or contrast.

    The log spectral distance over nine bands between 10 and 1000 Hz at 20, 45 and 100 mm/s.
    """

    one: Annotated[FileThere, Argument] = Field(description="Recording (.csv) or material.")
    other: Annotated[FileThere, Argument] = Field(description="Recording (.csv) or material.")

    def run(self, context: Context) -> Result:
        """Compare them."""
        from haptix.feel.materials import load
        from haptix.feel.materials.spectral import Energies, distance_db, stretch_of, stretches

        def energies(path: Path) -> Energies:
            is_recording = path.suffix == ".csv"
            return Energies(stretches(path) if is_recording else (stretch_of(load(path)),))

        apart_db = distance_db(energies(self.one), energies(self.other))
        row = {"one": str(self.one), "other": str(self.other), "distance_db": round(apart_db, 2)}
        return Result([row], [("distance of two textures", [row])])


_MAP_COLUMNS = 1200
_STEP_MM = 0.25  # between corners of a line
_CORNERS_HZ = 1000.0  # above this, skin feels no vibration


class ExportLayout(Task):
    """Export a layout in a format of other programs: a zip archive with a list of its losses.

    "document" keeps everything. "page" is a folder for any web server, which plays it without a
    service. "friction-map" is the friction under a finger that moves right at
    time 0. The others are one stroke to the right at 80 mm/s and 0.5 N.
    """

    document: Annotated[JsonObject, ForClients()] = Field(
        description="A layout, as `layout_set` takes it."
    )
    form: Literal["document", "page", "friction-map", "wav", "ahap", "hjif"]
    title: str = Field("Layout", max_length=100, description="Heading of a page.")
    y_mm: Annotated[float, Field(ge=-1e4, le=1e4)] = Field(
        0.0, description="Height of the stroke, for formats without places."
    )
    reachable_mu: Annotated[Range, Local()]
    finger: Annotated[FingerName, Local()]
    screen: Annotated[ScreenName, Local()]
    surface: Annotated[FileThere | None, Local()] = None

    def run(self, context: Context) -> Result:
        """Pack the files of the form; the layout's own are in the context's folder."""
        from haptix.feel.materials import material_of

        layout = material_of(self.document)
        left, right, top, bottom = layout.extent_mm
        if not right > left:
            raise InputError("layout: expected at least one region")
        with tempfile.TemporaryDirectory() as draft:
            folder = Path(draft)
            if self.form == "document":
                assert context.folder is not None
                _document(layout, context.folder, folder)
            elif self.form == "page":
                self._page(layout, folder)
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

    def _page(self, layout: Material, folder: Path) -> None:
        from haptix.play.touch_page import page_files
        from haptix.tasks.programs import compiled

        program = compiled(layout, self.finger, self.screen, self.surface)
        for name, content in page_files(program, layout, self.title).items():
            (folder / name).write_bytes(content)

    def _friction_map(self, layout: Material, folder: Path) -> None:
        import numpy as np

        from haptix.feel.layout.layout_material import shown_place_mm
        from haptix.feel.materials import as_mu
        from haptix.feel.materials.picture import picture
        from haptix.lab.stimuli.interchange import FrictionMap

        left, right, top, bottom = shown_place_mm(layout)
        width_mm = right - left
        wanted = picture(layout, width_mm, bottom - top, _MAP_COLUMNS, corner_mm=(left, top))
        mu = as_mu(layout.evaluator.target, wanted, *self.reachable_mu)
        reached = FrictionMap(np.clip(mu, *self.reachable_mu), width_mm, corner_mm=(left, top))
        reached.save(folder / "friction-map.png")

    def _line(self, layout: Material, folder: Path) -> None:
        import numpy as np

        from haptix.feel.along_path import MaterialSignal
        from haptix.feel.along_path import Path as Along
        from haptix.feel.materials import as_mu
        from haptix.feel.materials.field import FORCE_N, SPEED_MM_S
        from haptix.feel.motion import Motion
        from haptix.feel.signals.shapes import Points
        from haptix.lab.stimuli import StimulusSet
        from haptix.lab.stimuli.interchange import write_ahap, write_hjif
        from haptix.lab.stimuli.stimulus import Stimulus
        from haptix.model.finger import Finger
        from haptix.model.screen import Screen

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
            mu = as_mu(layout.evaluator.target, layout.wanted(motion), *self.reachable_mu)
            mu = np.clip(mu, *self.reachable_mu)
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
