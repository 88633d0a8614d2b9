"""Tasks of fingers: make one from measurements of its skin."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from haptix.base.errors import InputError
from haptix.base.fields import (
    Argument,
    FileThere,
    FingerName,
    ForClients,
    Local,
    NewDocument,
    NotNegative,
    Positive,
    Text,
    check_new,
)
from haptix.base.task import Context, Result, Task

if TYPE_CHECKING:
    from haptix.model.contact import RoughnessSpectrum
    from haptix.model.contact.topography import MeasuredSurface
    from haptix.model.finger import Finger

_LONGEST_TEXT = 4_000_000


class MakeFinger(Task, command="finger", route="fingers", keeps="results"):
    """Make a finger of measurements: height map, line scans or spectrum, and a dielectric table.

    Writes finger.toml and a picture: the map, its spectrum beside that of the model, and the waves
    that were added or are not known. A finger keeps what it was made of in its notes.
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
        from haptix.model.finger import Finger, MeasuredRoughness
        from haptix.model.friction import ContactModel
        from haptix.model.pair import profiles
        from haptix.model.screen import Screen

        if not self.measurements and self.text is None and self.dielectric is None:
            raise InputError(
                "measurements: expected a height map, line scans, a spectrum or --dielectric"
            )
        out = (context.folder or Path()) / self.out
        picture = out.with_suffix(".png")
        for path in (out, picture):
            check_new(path, self.overwrite, *self.measurements)
        base, _ = profiles(self.finger, "3m-sct3250")
        surface, spectrum, fields = None, None, {}
        if self.measurements or self.text is not None:
            context.progress("read the measurement", 0.0)
            surface, spectrum = self._spectrum()
            if self.h_rms_m is not None:
                spectrum.check_h_rms(self.h_rms_m)
            if self.hurst is not None or self.longest_m is not None:
                spectrum = spectrum.extended(self.hurst, q0=self._lowest)
            source = ", ".join(path.name for path in self.measurements) or "text"
            fields["roughness"] = MeasuredRoughness.of(spectrum, source)
        if self.dielectric is not None:
            from haptix.model.electro import SkinDielectric

            about = {} if self.beyond is None else {"beyond": self.beyond}
            fields["dielectric"] = SkinDielectric.read(
                self.dielectric, self.area_m2, self.thickness_m, **about
            )
        finger = base.replace(name=self.name, **fields)
        model = ContactModel(finger, Screen())
        mu = [float(ContactModel(f, Screen()).solve(0.5, 0.0).mu) for f in (finger, base)]
        row: dict[str, Any] = {"finger": str(self.out)}
        lines = [f"not measured: {what}" for what in model.placeholders()]
        if spectrum is not None:
            row |= _row(spectrum)
            lines = [*spectrum.notes, *lines]
            lines.append(
                f"friction without voltage at 0.5 N: {mu[0]:.3g}, with the roughness of {base.name} "
                f"{mu[1]:.3g}; tau_f is that of {base.name} until a calibration fits it"
            )
            if context.folder is not None:
                _draw(picture, finger, base, surface)
                row["picture"] = str(self.out.with_suffix(".png"))
        if isinstance(skin := fields.get("dielectric"), SkinDielectric if self.dielectric else ()):
            row["dielectric_hz"] = f"{skin.frequency_hz[0]:g} to {skin.frequency_hz[-1]:g}"
        if context.folder is not None:
            finger.save(out)
        document = {**row, "notes": lines, "content": finger.model_dump(mode="json")}
        return Result(document, [(f"haptix finger: {self.name}", [row])], lines)
