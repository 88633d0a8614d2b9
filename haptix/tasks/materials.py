"""Tasks of materials, the documents that say what a surface feels like."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from haptix.desk import Context, Result, Task
from haptix.fields import (
    Argument,
    FileThere,
    FingerName,
    MaterialFile,
    NewDocument,
    NewPicture,
    ScreenName,
    Seed,
    refuse_input,
)


class ShowMaterial(Task, command="material show"):
    """Draw a material: its friction by place, direction, speed, force and time."""

    file: Annotated[MaterialFile, Argument] = Field(
        description="Material: TOML or JSON, or gallery:NAME."
    )
    out: NewPicture | None = Field(None, description="Picture. [default: FILE with .png]")

    def run(self, context: Context) -> Result:
        """Write the picture."""
        from haptix.files import write_whole
        from haptix.gallery import load
        from haptix.materials import draw

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
        from haptix.materials import KINDS

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
        from haptix.gallery import presets

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
        from haptix.materials import schema

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
    out: NewDocument | None = Field(None, description="Material. [default: RECORDING with .toml]")
    finger: FingerName = Field("semi-wet", description="Finger that feels both.")
    screen: ScreenName = Field("3m-sct3250", description="Screen.")
    seed: Seed = Field(0, description="Seed of the pattern.")

    def run(self, context: Context) -> Result:
        """Fit, write and compare."""
        import tomlkit

        from haptix.files import write_whole
        from haptix.finger import Finger
        from haptix.friction import ContactModel
        from haptix.screen import Screen
        from haptix.simulation.bands import WITHIN_DB, band_name, felt_errors
        from haptix.texture.spectral import fit, stretches

        out = self.out or self.recording.with_suffix(".toml")
        refuse_input(out, self.recording)
        recorded = stretches(self.recording)
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
        from haptix.materials import load
        from haptix.texture.spectral import Energies, distance_db, stretch_of, stretches

        def energies(path: Path) -> Energies:
            is_recording = path.suffix == ".csv"
            return Energies(stretches(path) if is_recording else (stretch_of(load(path)),))

        apart_db = distance_db(energies(self.one), energies(self.other))
        row = {"one": str(self.one), "other": str(self.other), "distance_db": round(apart_db, 2)}
        return Result([row], [("distance of two textures", [row])])
