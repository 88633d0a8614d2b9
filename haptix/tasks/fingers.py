"""Tasks of fingers: make one from measurements of its skin."""

from __future__ import annotations

from math import log10, pi
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from haptix.base.errors import InputError, from_extra
from haptix.base.fields import (
    Argument,
    FileThere,
    ForClients,
    Local,
    NewDocument,
    Positive,
    Text,
    check_new,
)
from haptix.base.task import Context, Result, Task
from haptix.model.presets import FingerName

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from haptix.model.contact import RoughnessSpectrum
    from haptix.model.contact.topography import MeasuredSurface
    from haptix.model.finger import Finger

_LONGEST_TEXT = 4_000_000


class MakeFinger(Task, command="finger", route="fingers", keeps="results"):
    """Make a finger of a height map, line scans or a spectrum, and of a dielectric table.

    Writes finger.toml and a picture: the map, its spectrum beside that of the model, and the waves
    that were added or are not known. A finger keeps its sources in its notes.
    """

    measurements: Annotated[tuple[FileThere, ...], Argument] = Field(
        (),
        description="A height map, line scans, or a spectrum: .npy, text with units, or what "
        "SurfaceTopography reads.",
    )
    text: Annotated[Annotated[str, Field(max_length=_LONGEST_TEXT)], ForClients()] | None = Field(
        None, description="A map, a line scan or a spectrum as text with units, such as CSV."
    )
    dielectric: FileThere | None = Field(
        None, description="Table of the skin's dielectric, or readings of an LCR meter."
    )
    convention: Literal["C", "C_iso", "C_1D"] | None = Field(
        None,
        description="The measurement is a spectrum: C of Persson, C_iso or C_1D of Jacobs (2017), "
        "as SurfaceTopography writes them.",
    )
    h_rms_m: Positive | None = Field(
        None, description="Its rms roughness as known, to check convention and units."
    )
    unit: Text | None = Field(None, description="Unit of lengths that a file does not name: um.")
    pixel_m: Positive | None = Field(None, description="Distance between pixels, if not in it.")
    periodic: bool = Field(False, description="The map goes on at its borders as it began.")
    remove: Literal["mean", "plane", "radius", "form"] | None = Field(
        None,
        description="Remove the mean, a plane, a radius of curvature, or a fingertip's form. "
        "[default: plane]",
    )
    hurst: Annotated[float, Field(gt=0, le=1)] | None = Field(
        None, description="Extend the spectrum to 1e9 /m with this Hurst exponent, such as 0.86."
    )
    longest_m: Positive | None = Field(
        None, description="Extend it, as constant, to waves of this length."
    )
    area_m2: Positive | None = Field(None, description="Electrode of the LCR meter.")
    thickness_m: Positive | None = Field(None, description="Layer that the LCR meter measured.")
    beyond: Literal["refuse", "hold", "power-law"] | None = Field(
        None, description="Law beyond the ends of the dielectric table. [default: refuse]"
    )
    finger: FingerName = Field("semi-wet", description="Finger that has all other values.")
    name: Text = Field("measured", description="Name of the finger.")
    out: Annotated[NewDocument, Local()] = Field(
        Path("finger.toml"), description="File to write; the picture is beside it."
    )
    overwrite: bool = Field(False, description="Replace existing files.")

    def run(self, context: Context) -> Result:
        """Read, convert, and write finger and picture."""
        context.progress("read the measurements", 0.0)
        from haptix.base.files import write_whole
        from haptix.model.finger import MeasuredRoughness
        from haptix.model.friction import ContactModel
        from haptix.model.pair import profiles

        if not self.measurements and self.text is None and self.dielectric is None:
            raise InputError(
                "measurements: expected a height map, line scans or a spectrum, or --dielectric"
            )
        out = (context.folder or Path()) / self.out
        picture = out.with_suffix(".png")
        read = [*self.measurements, *([self.dielectric] if self.dielectric else [])]
        for path in (out, picture):
            check_new(path, self.overwrite, *read)
        base, screen = profiles(self.finger, "3m-sct3250")
        row: dict[str, Any] = {"finger": str(self.out)}
        notes: list[str] = []
        changed: dict[str, Any] = {}
        figure = None
        if self.measurements or self.text is not None:
            surface, spectrum = self._measured()
            if self.hurst is not None:
                spectrum = spectrum.extended(self.hurst)
            if self.longest_m is not None:
                spectrum = spectrum.extended(1.0, 0.0, 2 * pi / self.longest_m)
            source = ", ".join(path.name for path in self.measurements) or "text"
            changed["roughness"] = MeasuredRoughness.of(spectrum, source)
            figure = _drawn(surface, spectrum, base)
            row |= _row(spectrum) | {"picture": str(self.out.with_suffix(".png"))}
            notes += spectrum.notes
        if self.dielectric is not None:
            from haptix.model.electro import SkinDielectric

            law = {} if self.beyond is None else {"beyond": self.beyond}
            skin = SkinDielectric.read(self.dielectric, self.area_m2, self.thickness_m, **law)
            changed["dielectric"] = skin
            row["dielectric_hz"] = f"{skin.frequency_hz[0]:g} to {skin.frequency_hz[-1]:g}"
            notes.append(f"beyond these frequencies the dielectric: {_LAWS[skin.law]}")
        finger = base.replace(name=self.name, **changed)
        model = ContactModel(finger, screen)
        mu = float(model.solve(_FORCE_N, 0.0).mu)
        notes += [f"not measured: {what}" for what in model.placeholders()]
        notes.append(
            f"mu at {_FORCE_N:g} N and 0 V: {mu:.3g}, by the shear stress tau_f of {base.name}; a "
            "calibration fits it"
        )
        if figure is not None:
            drawn = figure
            write_whole(picture, lambda draft: drawn.savefig(draft, format="png", dpi=80))
        finger.save(out)
        document = {**row, "notes": notes, "content": finger.model_dump(mode="json")}
        return Result(document, [(f"haptix finger: {self.name}", [row])], notes)

    def _measured(self) -> tuple[MeasuredSurface | None, RoughnessSpectrum]:
        """Read the roughness, and compare its h_rms with the published one."""
        from haptix.model.contact import RoughnessSpectrum
        from haptix.model.contact.measured_files import MeasuredTable, read_spectrum, read_surface
        from haptix.model.contact.topography import MeasuredSurface

        unit = self.unit or ""
        sources: list[Path | MeasuredTable] = [*self.measurements]
        if self.text is not None:
            sources.append(MeasuredTable.of(self.text, "text"))
        surface = None
        if self.convention is not None:
            if len(sources) > 1:
                raise InputError(f"measurements: expected one spectrum, got {len(sources)} files")
            spectrum = read_spectrum(sources[0], self.convention, unit)
        else:
            periodic = self.periodic or None
            surface = MeasuredSurface.together(
                [read_surface(source, unit, self.pixel_m, periodic) for source in sources]
            )
            spectrum = RoughnessSpectrum.of_surface(surface, self.remove)
        if self.h_rms_m is not None:
            spectrum.check_h_rms(self.h_rms_m)
        return surface, spectrum


_FORCE_N = 0.5
_LAWS = {
    "refuse": "a drive is refused",
    "hold": "its last values hold",
    "power-law": "the power law of its last decade holds",
}


def _row(spectrum: RoughnessSpectrum) -> dict[str, Any]:
    low, high = spectrum.measured_per_m or (spectrum.q0, spectrum.q1)
    return {
        "h_rms_m": float(spectrum.h_rms_m),
        "slope_rms": float(spectrum.slope_rms),
        "longest_measured_m": 2 * pi / low,
        "shortest_measured_m": 2 * pi / high,
    }


def _drawn(surface: MeasuredSurface | None, spectrum: RoughnessSpectrum, base: Finger) -> Figure:
    """Draw the measurement, and its spectrum beside that of the finger that it replaces."""
    with from_extra("figures"):
        from matplotlib.figure import Figure
    import numpy as np
    import torch

    figure = Figure(figsize=(11, 4.5), layout="constrained")
    axes = figure.subplots(1, 1 if surface is None else 2, squeeze=False)[0]
    if surface is not None:
        height_um = surface.heights_m[0] * 1e6
        sides_mm = [n * d * 1e3 for n, d in zip(height_um.shape, surface.pixel_m, strict=False)]
        if surface.is_map:
            image = axes[0].imshow(height_um, extent=(0, sides_mm[1], sides_mm[0], 0))
            figure.colorbar(image, ax=axes[0], label="height (um)")
            axes[0].set(xlabel="x (mm)", ylabel="y (mm)", title="as measured")
        else:
            for scan, step_m in zip(surface.heights_m[:_SCANS], surface.pixel_m, strict=False):
                axes[0].plot(np.arange(len(scan)) * step_m * 1e3, scan * 1e6, lw=0.8)
            axes[0].set(xlabel="x (mm)", ylabel="height (um)", title="as measured")
    panel = axes[-1]
    for of, style, label in ((base.roughness.spectrum(), "C1--", base.name), (spectrum, "C0", "")):
        q = torch.logspace(log10(of.q0), log10(of.q1), 400, dtype=torch.float64).clamp(of.q0, of.q1)
        panel.loglog(q, of(q).detach(), style, label=label or "measured")
    low, high = spectrum.measured_per_m or (spectrum.q0, spectrum.q1)
    ends = ((spectrum.q0, low), (high, spectrum.q1))
    added = [(start, end) for start, end in ends if start < end * (1 - 1e-9)]
    for number, (start, end) in enumerate(added):
        label = "" if number else "added by a law"
        panel.axvspan(start, end, color="0.5", alpha=0.3, label=label)
    panel.set(xlabel="q (1/m)", ylabel="C (m$^4$)", title=_title(spectrum))
    panel.legend()
    return figure


_SCANS = 8


def _title(spectrum: RoughnessSpectrum) -> str:
    h_rms, slope = float(spectrum.h_rms_m), float(spectrum.slope_rms)
    return f"h_rms {h_rms * 1e6:.3g} um, rms slope {slope:.3g}"
