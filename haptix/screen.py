"""The screen: its insulator, and the voltage it may carry."""

from __future__ import annotations

import hashlib
import json
import warnings
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field

from haptix.documents import Document, Part
from haptix.presets import SCREENS

Plain = Annotated[float, Field(gt=0, strict=True)]
Permittivity = Annotated[float, Field(ge=1)]


CALIBRATION_VALID_DAYS = 365
"""Age [days] from which a calibration counts as old: insulators wear and take up water."""


NO_INSTRUMENT = "(no instrument)"
"""What stands behind a virtual instrument in place of its serial number."""


class CalibrationWarning(UserWarning):
    """A screen's profile is a placeholder, failed its verification, is old or was edited."""


class Calibration(Part):
    """How a calibrated profile was measured.

    Parameters
    ----------
    date : datetime.date
        When it was measured.
    operator : str
        Name of the person who measured.
    instruments : tuple of str
        Names and serial numbers.
    verdict : {"passed", "provisional", "failed"}
        Result of the verification on strokes kept out of the fit; "provisional" where they agree
        but the rig, or the carrier, was not checked.
    spread : mapping of str to float
        Standard deviation of the logarithm of each number that was found, such as 0.02 for 2 %.
    rests_on : tuple of str
        What was assumed and not measured.
    finger_hash : str
        `Finger.content_hash` of the finger that was measured with it; empty in older profiles.
    content_hash : str
        SHA-256 of the profile as it was written; an edited profile has another one.
    """

    date: date
    operator: str = ""
    instruments: tuple[str, ...] = ()
    verdict: Literal["passed", "provisional", "failed"]
    spread: dict[str, float] = Field(default={})
    rests_on: tuple[str, ...] = ()
    finger_hash: Annotated[str, Field(exclude_if=lambda value: not value)] = ""
    content_hash: str = ""

    @property
    def is_virtual(self) -> bool:
        """Whether a virtual finger was measured, and no screen."""
        return any(NO_INSTRUMENT in one for one in self.instruments)


class Screen(Document):
    """One touchscreen. A calibration writes a profile of its own.

    The preset "3m-sct3250" is the screen of the paper (1 um of SiO2, eps1 = 8).

    Parameters
    ----------
    name : str
        Name of the screen.
    insulator_thickness_m, insulator_permittivity
        d1 [m] and eps1 of the insulator over the conductor.
    insulator_strength_v_per_m
        Field [V/m] that the insulator withstands, for a film of SiO2 500 to 1000 V/um.
    gap_resistivity_ohm_m
        Resistivity of what fills the gap [Ohm m], or None for dry air.
    max_voltage_v
        Highest amplitude [V] the screen may carry; anything above is rejected, never clamped.
    body_capacitance_f
        Capacitance [F] from a finger on this rig through the person to earth, 100 to 150 pF for a
        person who stands free; more for one who is earthed or leans on the frame. It closes the
        circuit (term "body-return"). Above 150 pF it lowers the highest amplitude of every drive;
        below, it raises none.
    width_mm, height_mm : float or None
        Size of the picture on the screen, for `haptix.layout.ScreenGeometry.on`.
    is_placeholder : bool
        True where the numbers are a guess; everything that is made with it says so.
    calibration : Calibration or None
        Where the numbers come from, for a profile that a calibration has written.
    """

    presets: ClassVar = SCREENS

    name: str = "custom"
    insulator_thickness_m: Plain = 1e-6
    insulator_permittivity: Permittivity = 8.0
    insulator_strength_v_per_m: Plain = 500e6
    gap_resistivity_ohm_m: Plain | None = None
    max_voltage_v: Plain = 200.0
    # The body of IEC 61000-4-2, by which every drive is limited (firmware_io.limits). Left out
    # where it is that: files and hashes of earlier versions have no such field.
    body_capacitance_f: Annotated[Plain, Field(exclude_if=lambda value: value == 150e-12)] = 150e-12
    # Left out where they are unknown, as above.
    width_mm: Annotated[Plain | None, Field(exclude_if=lambda value: value is None)] = None
    height_mm: Annotated[Plain | None, Field(exclude_if=lambda value: value is None)] = None
    is_placeholder: bool = False
    calibration: Calibration | None = None

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a TOML file; see `haptix.documents.Document.load`.

        Warns
        -----
        CalibrationWarning
            For each of `warnings`; outputs name them as well.
        """
        screen = super().load(path)
        for one in screen.warnings():
            warnings.warn(f"{path}: {one}", CalibrationWarning, stacklevel=2)
        return screen

    def warnings(self) -> list[str]:
        """Reasons not to trust the profile, as outputs quote them; none for presets."""
        reasons = ["a placeholder, not calibrated"] if self.is_placeholder else []
        if (made := self.calibration) is not None:
            if made.verdict == "failed":
                reasons.append("its calibration failed verification")
            if made.verdict == "provisional":
                reasons.append(
                    "its calibration is provisional: add `haptix calibrate rig`, and held-out "
                    "strokes at the carrier, and verify again"
                )
            if (datetime.now(UTC).date() - made.date).days > CALIBRATION_VALID_DAYS:
                reasons.append(
                    f"its calibration of {made.date} is more than {CALIBRATION_VALID_DAYS} days old"
                )
            if made.content_hash != self.content_hash():
                reasons.append("its profile was changed after the calibration")
        return [f"screen {self.name!r} ({reason})" for reason in reasons]

    def content_hash(self) -> str:
        """SHA-256 of everything in the profile but the hash itself."""
        fields = self.model_dump(mode="json")
        if fields["calibration"] is not None:
            del fields["calibration"]["content_hash"]
        return hashlib.sha256(json.dumps(fields, sort_keys=True).encode()).hexdigest()

    @property
    def calibration_id(self) -> str:
        """Name of this profile that a driver can hold: the start of its content's hash."""
        return self.content_hash()[:16]

    @property
    def h0_m(self) -> float:
        """Effective thickness d1/eps1 of the screen's insulator [m]."""
        return self.insulator_thickness_m / self.insulator_permittivity
