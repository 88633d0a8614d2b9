"""The scene: finger, screen, drive and textures of a surface, and the largest error allowed."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import torch
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PositiveFloat,
    field_validator,
    model_validator,
)

from haptix.base.documents import Document, Part
from haptix.base.errors import InputError
from haptix.base.kinds import in_folder
from haptix.feel.materials.material import AnyMaterial
from haptix.feel.materials.panels import material_of
from haptix.model.contact import TheoryName
from haptix.model.fidelity import FIDELITIES, FidelityName
from haptix.model.finger import Finger
from haptix.model.friction import ContactModel
from haptix.model.pair import finger_beside
from haptix.model.screen import Screen
from haptix.model.surface.axes import AXES, low_and_high
from haptix.model.terms import TERMS, possible_terms

DtypeName = Literal["float32", "float64"]


def _collapsible(name: str) -> str:
    known = [axis.name for axis in AXES if axis.is_collapsible]
    if name not in known:
        raise ValueError(f"expected {' or '.join(map(repr, known))}")
    return name


AxisName = Annotated[str, AfterValidator(_collapsible)]
"""Name of an axis that a surface can do without."""

Range = Annotated[tuple[float, float], BeforeValidator(low_and_high)]
"""(low, high), both above 0; one number stands for both."""


class DirectDrive(Part):
    """The screen is driven at half of the frequency that is felt."""

    scheme: Literal["direct"]
    frequency_hz: Range
    """Range of the drive, or one value."""
    waveform: Literal["sine", "square"] = "sine"
    """Shape of the drive."""
    max_voltage_v: PositiveFloat | None = None
    """Highest amplitude; by default the screen's limit."""


class CarrierDrive(Part):
    """A carrier too fast to be felt, with an envelope that is felt."""

    scheme: Literal["carrier"]
    carrier_hz: Range
    """Frequency of the carrier; a range if devices or settings differ."""
    envelope_hz: PositiveFloat | None = None
    """Highest frequency of the envelope."""
    max_voltage_v: PositiveFloat | None = None
    """Highest amplitude; by default the screen's limit."""

    @model_validator(mode="after")
    def _envelope_is_slower(self) -> Self:
        # Above half of the carrier the side bands overlap.
        if self.envelope_hz is not None and self.envelope_hz > self.carrier_hz[0] / 2:
            raise ValueError("expected envelope_hz of at most half of carrier_hz")
        return self


class SceneTexture(Part):
    """One texture of a scene."""

    file: Annotated[str, Field(min_length=1)]
    """Photograph, relative to the scene's folder; it may be missing until it is used."""
    width_mm: PositiveFloat
    """Width on the screen."""
    mu_range: Range | None = None
    """Absolute friction coefficients instead of shares of the reachable range."""


class Override(Part):
    """Decisions that planning must keep, by name."""

    terms: dict[str, Annotated[bool, Field(strict=True)]] = Field(default={})
    """Terms to switch on or off."""
    fidelity: FidelityName | None = None
    theory: TheoryName | None = None
    dtype: DtypeName | None = None
    tolerance: Annotated[float, Field(strict=True)] | str | None = None
    """How the contact is solved, the form of its mean field (by default the finger's), the
    precision of the surface, and its largest error against the planned model (a number in mu,
    ``"0.05 JND"`` or ``"0.2 %"``)."""
    axes: dict[AxisName, Literal["keep", "collapse"]] = Field(default={})
    """Whether the surface keeps the axis ``frequency_hz`` or ``h0_m``."""

    @field_validator("terms")
    @classmethod
    def _are_known(cls, terms: dict[str, bool]) -> dict[str, bool]:
        unknown = sorted(set(terms) - set(TERMS))
        if unknown:
            raise ValueError(
                f"unknown {', '.join(map(repr, unknown))}; expected any of {', '.join(TERMS)}"
            )
        return terms


class Scene(Document):
    """Everything that a friction surface depends on.

    Parameters
    ----------
    name : str
        Name of the scene.
    finger, screen : Finger and Screen
        Or the name of a preset, or the path of a TOML file relative to `folder`, or a table.
        Without a finger, a file of a calibrated screen takes the ``finger.toml`` beside it.
    normal_force_n : (float, float)
        Range of the normal force [N], or one value.
    drive : DirectDrive or CarrierDrive
        How the screen is driven; the key `scheme` selects one.
    speed_mm_per_s : (float, float), optional
        Range of the finger's speed. It changes how a texture feels, not friction in the model.
    h0_m : (float, float), optional
        Range of the screens' d1/eps1 [m]; by default the screen's own.
    textures : tuple of SceneTexture
        Textures of the scene.
    materials : tuple of material
        Materials of the scene: tables, or paths of their files relative to `folder`.
    not_shown : {"warn", "refuse"}
        What planning does where the theory's accuracy was not shown, see `Accuracy`.
    budget_jnd : float
        Largest error of friction in just-noticeable differences (JND) of ``0.11 mu``.
    override : Override
        Decisions that planning must keep.
    folder : Path
        Folder to which paths are relative: that of the file, or the current one.

    Raises
    ------
    InputError
        If a field is unknown, missing or outside its range.

    Examples
    --------
    >>> drive = {"scheme": "carrier", "carrier_hz": 10e3}
    >>> scene = Scene(finger="wet", screen="3m-sct3250", normal_force_n=(0.2, 0.8), drive=drive)
    >>> scene.finger.name
    'wet'
    """

    name: str = "custom"
    finger: Finger
    screen: Screen
    normal_force_n: Range
    drive: Annotated[DirectDrive | CarrierDrive, Field(discriminator="scheme")]
    speed_mm_per_s: Range | None = None
    h0_m: Range | None = None
    textures: tuple[SceneTexture, ...] = ()
    materials: tuple[AnyMaterial, ...] = ()
    budget_jnd: PositiveFloat = 0.5
    not_shown: Literal["warn", "refuse"] = "warn"
    override: Override = Override()
    folder: Annotated[Path, Field(exclude=True)] = Path()

    @model_validator(mode="before")
    @classmethod
    def _look_names_up(cls, fields: Any) -> Any:
        if not isinstance(fields, dict):
            return fields
        read, folder = dict(fields), Path(fields.get("folder", "."))
        screen = "" if "finger" in fields else fields.get("screen")
        if isinstance(screen, str) and (finger_file := finger_beside(screen, folder)):
            read["finger"] = finger_file
        if isinstance(materials := fields.get("materials"), list | tuple):
            with in_folder(folder):
                read["materials"] = [material_of(material) for material in materials]
        kinds: Mapping[str, type[Finger | Screen]] = {"finger": Finger, "screen": Screen}
        for key, kind in kinds.items():
            match read.get(key):
                case dict() as table:
                    read[key] = kind(**table)
                case str() as name:
                    read[key] = kind.named(name, folder)
        return read

    @model_validator(mode="after")
    def _within_the_limit(self) -> Self:
        limit = self.screen.max_voltage_v
        if self.max_voltage_v > limit:
            raise ValueError(
                f"drive.max_voltage_v: expected at most the {limit:g} V of screen "
                f"{self.screen.name!r}, got {self.max_voltage_v:g} V"
            )
        return self

    def save(self, path: str | Path) -> None:
        """Write the scene as TOML, with finger and screen written out and paths kept relative."""
        folder = Path(path).parent
        moved = [
            texture.model_copy(update={"file": os.path.relpath(self.folder / texture.file, folder)})
            for texture in self.textures
        ]
        with in_folder(folder):
            Document.save(self.replace(textures=moved, folder=folder), path)

    @property
    def max_voltage_v(self) -> float:
        """Highest amplitude [V] of the drive."""
        return self.drive.max_voltage_v or self.screen.max_voltage_v

    def ranges(self) -> dict[str, tuple[float, float]]:
        """Ranges for `FrictionSurface.build`.

        Raises
        ------
        InputError
            If the drive is not a sine: a friction surface holds the attraction of a sine only.
        """
        drive = self.drive
        if isinstance(drive, DirectDrive) and drive.waveform != "sine":
            raise InputError(
                'drive.waveform: a friction surface holds the attraction of a sine, got "square"; '
                'use "sine" here, and ContactModel.over_period for other shapes'
            )
        frequency_hz = drive.frequency_hz if isinstance(drive, DirectDrive) else drive.carrier_hz
        h0 = self.screen.h0_m
        return {
            "normal_force_n": self.normal_force_n,
            "voltage_v": (0.0, self.max_voltage_v),
            "frequency_hz": frequency_hz,
            "h0_m": (h0, h0) if self.h0_m is None else self.h0_m,
        }

    def possible_terms(self, fidelity: FidelityName = "mean-field") -> frozenset[str]:
        """Names of all terms that finger, screen and fidelity allow to be on."""
        return possible_terms(self.finger, self.screen, FIDELITIES[fidelity])

    def terms(self, fidelity: FidelityName = "mean-field") -> frozenset[str]:
        """Names of the possible terms; of those left to the scene, only those it asks for."""
        wanted, possible = self.override.terms, self.possible_terms(fidelity)
        return frozenset(t for t in possible if wanted.get(t) or not TERMS[t].left_to_scene)

    def model(
        self,
        fidelity: FidelityName = "mean-field",
        dtype: torch.dtype = torch.float64,
        device: torch.device | str = "cpu",
        terms: frozenset[str] | None = None,
    ) -> ContactModel:
        """Return the contact model of the scene, with some terms or its own.

        Parameters
        ----------
        fidelity : str
            How the contact is solved, see `ContactModel`.
        dtype, device
            Precision of the numbers, and where they are.
        terms : set of str, optional
            Terms of the model; the scene's own if not given.
        """
        on = self.terms(fidelity) if terms is None else terms
        return ContactModel(
            self.finger,
            self.screen,
            fidelity=fidelity,
            dtype=dtype,
            device=device,
            terms=on,
            theory=self.override.theory,
        )
