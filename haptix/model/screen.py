"""The screen: its insulator, and the voltage it may carry."""

from __future__ import annotations

import warnings
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from haptix.base.checks import Array
from haptix.base.documents import Document, Part
from haptix.base.files import digest
from haptix.model.presets import SCREENS

Plain = Annotated[float, Field(gt=0, strict=True)]
Permittivity = Annotated[float, Field(ge=1)]


CALIBRATION_VALID_DAYS = 365
"""Age [days] from which a calibration counts as old: insulators wear and take up water."""


_SLACK = 1.1

NO_INSTRUMENT = "(no instrument)"
"""Text that a virtual instrument has in place of a serial number."""


class CalibrationWarning(UserWarning):
    """A screen's profile is a placeholder, failed its verification, is old or was edited."""


Ends = tuple[float, float]


class VerifiedRange(Part):
    """Ranges, lowest and highest, in which strokes kept out of the fit verified the profile."""

    normal_force_n: Ends
    frequency_hz: Ends
    speed_mm_per_s: Ends
    """Ranges of the strokes, as they were measured."""
    voltage_v: Annotated[tuple[Ends, ...], Field(min_length=1)]
    """Pairs of a frequency and the highest amplitude at it; linear over ln f in between."""
    contact_s: Annotated[float | None, Field(exclude_if=lambda value: value is None)] = None
    """Longest time in contact; None where no stroke stated one."""

    @property
    def text(self) -> str:
        """One line for people."""
        volts = ", ".join(f"{most:.3g} V at {hertz:g} Hz" for hertz, most in self.voltage_v)
        lasts = "" if self.contact_s is None else f", contacts of up to {self.contact_s:.3g} s"
        return (
            f"{self.normal_force_n[0]:.2g} to {self.normal_force_n[1]:.2g} N, up to {volts}, "
            f"{self.speed_mm_per_s[0]:.3g} to {self.speed_mm_per_s[1]:.3g} mm/s{lasts}"
        )

    def highest_v(self, frequency_hz: float) -> float:
        """Highest amplitude [V] that is verified at a frequency."""
        return float(self._highest(frequency_hz))

    def largest(self, frequency_hz: float) -> tuple[float, float, float, float]:
        """Largest force [N], speed [mm/s], contact time [s] and amplitude [V] within the range.

        Parameters
        ----------
        frequency_hz : float
            Frequency of the drive [Hz].
        """
        return (
            _SLACK * self.normal_force_n[1],
            _SLACK * self.speed_mm_per_s[1],
            _SLACK * (self.contact_s or np.inf),
            _SLACK * self.highest_v(frequency_hz),
        )

    def _highest(self, frequency_hz: ArrayLike) -> Array:
        hertz, volts = np.array(self.voltage_v).T
        at = np.log(np.asarray(frequency_hz, dtype=float))
        return np.asarray(np.interp(at, np.log(hertz), volts))

    def beyond(
        self,
        normal_force_n: ArrayLike,
        voltage_v: ArrayLike,
        frequency_hz: ArrayLike | None = None,
        speed_mm_per_s: ArrayLike | None = None,
        contact_s: ArrayLike | None = None,
    ) -> list[str]:
        """Describe which of these values, one or several of each, lie outside by over 10 %.

        A person cannot hold force and speed more exactly. Without a frequency the skin conducts,
        which no stroke verified; the bound then is the highest amplitude at any frequency.
        """
        notes = []
        if frequency_hz is None and np.asarray(voltage_v).any():
            low, high = self.frequency_hz
            notes.append(
                f"no frequency, so that the skin conducts: verified {low:.3g} to {high:.3g} Hz"
            )
        for name, unit, values, (low, high) in (
            ("force", "N", normal_force_n, self.normal_force_n),
            ("frequency", "Hz", frequency_hz, self.frequency_hz),
            ("speed", "mm/s", speed_mm_per_s, self.speed_mm_per_s),
            ("contact", "s", contact_s, (0.0, self.contact_s or np.inf)),
        ):
            used = np.asarray([] if values is None else values, dtype=float)
            outside = used[(used < low / _SLACK) | (used > high * _SLACK)]
            if outside.size:
                notes.append(f"{name} {_reached(outside)} {unit}: verified {low:.3g} to {high:.3g}")
        highest = np.array(self.voltage_v)[:, 1].max()
        if frequency_hz is not None:
            highest = self._highest(frequency_hz)
        used, highest = np.broadcast_arrays(np.asarray(voltage_v, dtype=float), highest)
        is_above = used > highest * _SLACK
        if is_above.any():
            most = float(highest[is_above].max())
            notes.append(f"amplitude {_reached(used[is_above])} V: verified to {most:.3g}")
        return notes


def _reached(values: Array) -> str:
    low, high = (f"{end:.3g}" for end in (values.min(), values.max()))
    return low if low == high else f"{low} to {high}"


class Calibration(Part):
    """How a calibrated profile was measured."""

    date: date
    """When it was measured."""
    operator: str = ""
    """Name of the person who measured."""
    instruments: tuple[str, ...] = ()
    """Names and serial numbers."""
    verdict: Literal["passed", "provisional", "failed"]
    """Result of the verification on strokes kept out of the fit; "provisional" where they agree but
    the rig, or the carrier, was not checked."""
    spread: dict[str, float] = Field(default={})
    """Standard deviation of the logarithm of each number that was found, such as 0.02 for 2 %."""
    rests_on: tuple[str, ...] = ()
    """What was assumed and not measured."""
    finger_hash: Annotated[str, Field(exclude_if=lambda value: not value)] = ""
    """`Finger.content_hash` of the finger that was measured with it; empty where none is known."""
    verified: Annotated[VerifiedRange | None, Field(exclude_if=lambda value: value is None)] = None
    """Where the verification holds; None where it failed."""
    content_hash: str = ""
    """SHA-256 of the profile as it was written; an edited profile has another one."""

    @property
    def is_virtual(self) -> bool:
        """Whether the calibration measured a virtual finger and no screen."""
        return any(NO_INSTRUMENT in instrument for instrument in self.instruments)


class TouchArea(Part):
    """The touch panel on the picture, as `haptix touchscreen calibrate` finds it with a finger.

    Parameters
    ----------
    width_mm, height_mm : float
        Size of the picture [mm].
    matrix : tuple of 6 float
        From shares of the panel's axes to shares of the picture, see `haptix.play.ScreenAxes`.
    rate_hz : float or None
        Reports per second of a finger that moves.
    """

    width_mm: Plain
    height_mm: Plain
    matrix: tuple[float, float, float, float, float, float]
    rate_hz: Annotated[Plain | None, Field(exclude_if=lambda value: value is None)] = None


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
        Size of the picture on the screen, for `haptix.feel.ScreenGeometry.on`.
    touch : TouchArea or None
        Where the touch panel lies on the picture.
    is_placeholder : bool
        True where the numbers are a guess; everything that is made with it is marked so.
    calibration : Calibration or None
        Where the numbers come from, for a profile that a calibration has written.

    Examples
    --------
    >>> Screen.preset("3m-sct3250").max_voltage_v <= 200.0
    True
    """

    presets: ClassVar = SCREENS

    name: str = "custom"
    insulator_thickness_m: Plain = 1e-6
    insulator_permittivity: Permittivity = 8.0
    insulator_strength_v_per_m: Plain = 500e6
    gap_resistivity_ohm_m: Plain | None = None
    max_voltage_v: Plain = 200.0
    # The default is the body of IEC 61000-4-2, which limits every drive (firmware_io.limits). Files
    # and hashes leave it out.
    body_capacitance_f: Annotated[Plain, Field(exclude_if=lambda value: value == 150e-12)] = 150e-12
    # A file leaves them out if they are unknown, as above.
    width_mm: Annotated[Plain | None, Field(exclude_if=lambda value: value is None)] = None
    height_mm: Annotated[Plain | None, Field(exclude_if=lambda value: value is None)] = None
    touch: Annotated[TouchArea | None, Field(exclude_if=lambda value: value is None)] = None
    is_placeholder: bool = False
    calibration: Calibration | None = None

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a TOML file; see `haptix.base.documents.Document.load`.

        Warns
        -----
        CalibrationWarning
            For each of `warnings`; outputs name them as well.
        """
        screen = super().load(path)
        for reason in screen.warnings():
            warnings.warn(f"{path}: {reason}", CalibrationWarning, stacklevel=2)
        return screen

    def warnings(self) -> list[str]:
        """Reasons not to trust the profile, as outputs quote them; none for presets.

        Examples
        --------
        >>> Screen().warnings()
        []
        """
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

    @property
    def verified(self) -> VerifiedRange | None:
        """Range in which its calibration is verified; None where none is stated."""
        return None if self.calibration is None else self.calibration.verified

    def content_hash(self) -> str:
        """SHA-256 of all in the profile that friction depends on: not the hash, nor the panel."""
        fields = self.model_dump(mode="json", exclude={"touch"})
        if fields["calibration"] is not None:
            del fields["calibration"]["content_hash"]
        return digest(fields)

    @property
    def calibration_id(self) -> str:
        """Short name of this profile, for the driver to store: the start of its content's hash."""
        return self.content_hash()[:16]

    @property
    def h0_m(self) -> float:
        """Effective thickness d1/eps1 of the screen's insulator [m].

        Examples
        --------
        >>> Screen(insulator_thickness_m=1e-6, insulator_permittivity=4.0).h0_m
        2.5e-07
        """
        return self.insulator_thickness_m / self.insulator_permittivity
