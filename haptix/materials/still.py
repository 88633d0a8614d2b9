"""Kinds whose friction depends on the place alone: the documents of `haptix.texture`."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Any, Literal

from pydantic import Field, PlainSerializer, PlainValidator, PositiveFloat, WithJsonSchema

from haptix.checks import plain
from haptix.documents import Part
from haptix.errors import InputError
from haptix.materials.material import (
    ANY_KIND,
    AnyAsset,
    AnyMaterial,
    Material,
    Scaled,
    material_of,
    table_of,
)
from haptix.materials.sharing import shared
from haptix.texture import (
    Composition,
    FrictionField,
    Grating,
    Noise,
    PennModel,
    RecordedProfile,
    Sprite,
    Texture,
    power_law,
)
from haptix.texture.composition import Blend
from haptix.texture.levels import HeightRule
from haptix.texture.penn import TOOL_MASS_KG
from haptix.texture.texture import Polarity
from haptix.waves import Shape


def field_of(material: Material) -> FrictionField:
    """Field of a material that depends on the place alone; `InputError` for any other."""
    found = material.evaluator
    if not isinstance(found, FrictionField):
        raise InputError(
            f"expected a material that stands still, got {material.kind}; the kind layout takes "
            "every kind in its regions"
        )
    return found


class _OfFile:
    """Base of those whose field is made of a file and plain parameters."""

    @property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """Of a photograph or heights, their size."""
        field = self.evaluator  # type: ignore[attr-defined]
        if not isinstance(field, Texture):
            return super().extent_mm  # type: ignore[misc, no-any-return]
        return (0.0, field.width_mm, 0.0, field.height_mm)

    @property
    def _parameters(self) -> dict[str, Any]:
        return self.model_dump(mode="json", exclude={"file"})  # type: ignore[attr-defined, no-any-return]


class PhotographMaterial(_OfFile, Scaled):
    """A photograph, whose grey from the 1st to the 99th percentile becomes friction.

    Parameters
    ----------
    file : str
        The photograph: PNG, JPEG or TIFF.
    width_mm : float
        Width on the screen; the height follows from the pixels.
    polarity : {"bright-high", "dark-high"}
        Which end of the grey scale has the higher friction.
    """

    kind: Literal["photograph"] = "photograph"
    file: AnyAsset
    width_mm: PositiveFloat
    polarity: Polarity = "bright-high"

    @cached_property
    def evaluator(self) -> FrictionField:
        """A `haptix.Texture`."""
        ranges: Any = {f"{self.target}_range": (self.low, self.high)}
        return shared(
            self.file,
            self._parameters,
            lambda path: Texture.from_image(path, self.width_mm, self.polarity, **ranges),
        )


class HeightsMaterial(_OfFile, Scaled):
    """A height map, felt by one rule; `relief` is right in every direction.

    Parameters
    ----------
    file : str
        Picture of the heights, bright is high.
    width_mm : float
        Width on the screen.
    rule : {"height", "slope-magnitude", "slope-along"}
        What makes friction.
    direction_deg : float
        Direction of the stroke for "slope-along": 0 to the right, 90 down.
    """

    kind: Literal["heights"] = "heights"
    file: AnyAsset
    width_mm: PositiveFloat
    rule: HeightRule = "height"
    direction_deg: float = 0.0

    @cached_property
    def evaluator(self) -> FrictionField:
        """A `haptix.Texture`."""
        ranges: Any = {f"{self.target}_range": (self.low, self.high)}
        return shared(
            self.file,
            self._parameters,
            lambda path: Texture.from_heights(
                path, self.width_mm, self.rule, self.direction_deg, **ranges
            ),
        )


class GratingMaterial(Scaled):
    """A periodic wave without end; see `haptix.texture.Grating`.

    Parameters
    ----------
    period_mm : float
        Distance from one rib to the next.
    wave : {"sine", "square", "sawtooth"}
        Shape of the ribs.
    orientation_deg : float
        Direction in which it runs: 0 to the right, 90 down.
    duty : float
        Part of the period for which the square wave is high.
    phase : float
        Part of the period that lies before the origin.
    """

    kind: Literal["grating"] = "grating"
    period_mm: PositiveFloat
    wave: Shape = "sine"
    orientation_deg: float = 0.0
    duty: Annotated[float, Field(gt=0, lt=1)] = 0.5
    phase: float = 0.0

    @cached_property
    def evaluator(self) -> FrictionField:
        """A `haptix.texture.Grating`."""
        fields = {name: value for name, value in self.values_of_fields().items() if name != "kind"}
        return Grating(**fields)


class NoiseMaterial(Material):
    """Gaussian noise of a power law on a tile that repeats; see `haptix.texture.Noise`.

    Parameters
    ----------
    exponent : float
        The power falls with the wavenumber to this power: 0 is white.
    shortest_mm, longest_mm : float
        Sizes of the smallest and of the largest unevenness: there is power between them.
    mean, deviation : float
        Mean of the friction, and how far it strays from it.
    target : {"share", "mu", "contrast"}
        What these are: shares of what the screen can reach, friction coefficients, or relative
        changes of friction.
    seed : int
        Same seed, same noise.
    tile_mm : float
        Side of the tile.
    pixels : int
        Pixels along it, a power of two.
    grain : {"isotropic", "ribbed"}
        Noise over the plane, or along one direction.
    orientation_deg : float
        Direction of the ribbed grain: 0 to the right, 90 down.
    """

    kind: Literal["noise"] = "noise"
    exponent: float = 2.0
    shortest_mm: PositiveFloat = 0.5
    longest_mm: PositiveFloat = 10.0
    mean: float = 0.5
    deviation: PositiveFloat = 0.2
    target: Literal["share", "mu", "contrast"] = "share"
    seed: Annotated[int, Field(ge=0)] = 0
    tile_mm: PositiveFloat = 64.0
    pixels: Annotated[int, Field(ge=4, le=4096)] = 1024
    grain: Literal["isotropic", "ribbed"] = "isotropic"
    orientation_deg: float = 0.0

    @cached_property
    def evaluator(self) -> FrictionField:
        """A `haptix.texture.Noise`."""
        spectrum = power_law(self.exponent, self.shortest_mm, self.longest_mm)
        left_out = {"kind", "exponent", "shortest_mm", "longest_mm"}
        return Noise(
            spectrum,
            **{
                name: value
                for name, value in self.values_of_fields().items()
                if name not in left_out
            },
        )


class RecordingMaterial(_OfFile, Material):
    """Friction recorded along a line, the same across it.

    Parameters
    ----------
    file : str
        CSV with position_mm and mu, or with position_mm and forces.
    normal_force_n : float, optional
        The normal force of the recording, where it is no column.
    orientation_deg : float
        Direction of the line: 0 to the right, 90 down.
    beyond : {"outside", "hold"}
        Friction beyond the ends: the lowest, or that of the end.
    step_mm : float, optional
        Step of the even grid on which it is kept.
    """

    kind: Literal["recording"] = "recording"
    file: AnyAsset
    normal_force_n: PositiveFloat | None = None
    orientation_deg: float = 0.0
    beyond: Literal["outside", "hold"] = "outside"
    step_mm: PositiveFloat | None = None

    @cached_property
    def evaluator(self) -> FrictionField:
        """A `haptix.texture.RecordedProfile`."""
        options = {
            name: value
            for name, value in self.values_of_fields().items()
            if name not in ("kind", "file")
        }
        return shared(
            self.file, self._parameters, lambda path: RecordedProfile.from_csv(path, **options)
        )


class PennMaterial(_OfFile, Material):
    """A model of the Penn Haptic Texture Toolkit at one speed and force.

    Parameters
    ----------
    file : str
        XML of the model.
    speed_mm_per_s, normal_force_n : float
        Where the pattern has the model's spectrum.
    mass_kg : float
        Turns accelerations into forces; an assumption.
    seed : int
        Same seed, same pattern.
    orientation_deg : float
        Direction of the stroke.
    """

    kind: Literal["penn"] = "penn"
    file: AnyAsset
    speed_mm_per_s: PositiveFloat = 100.0
    normal_force_n: PositiveFloat = 0.5
    mass_kg: PositiveFloat = TOOL_MASS_KG
    seed: Annotated[int, Field(ge=0)] = 0
    orientation_deg: float = 0.0

    @cached_property
    def evaluator(self) -> FrictionField:
        """A `haptix.texture.Noise`."""
        options = {
            name: value
            for name, value in self.values_of_fields().items()
            if name not in ("kind", "file")
        }
        return shared(
            self.file, self._parameters, lambda path: PennModel.load(path).texture(**options)
        )


def _number_or_material(value: Any) -> float | Material:
    number = plain(value)
    return material_of(value) if number is None else number


NumberOrMaterial = Annotated[
    float | Material,
    PlainValidator(_number_or_material),
    PlainSerializer(lambda value: value if isinstance(value, float) else table_of(value)),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"title": ANY_KIND}]}),
]


class SpriteTable(Part):
    """A material within a shape; see `haptix.texture.Sprite`."""

    of: AnyMaterial
    x_mm: float = 0.0
    y_mm: float = 0.0
    width_mm: PositiveFloat | None = None
    height_mm: PositiveFloat | None = None
    z: float = 0.0
    blend: Blend = "over"
    opacity: Annotated[float, Field(ge=0, le=1)] = 1.0
    shape: Literal["rectangle", "ellipse"] = "rectangle"
    mask: AnyMaterial | None = None


class CompositionMaterial(Material):
    """Still materials on a background; see `haptix.texture.Composition`.

    The kind ``layout`` does the same with every material, and can be changed while it plays.

    Parameters
    ----------
    sprites : list of tables
        Each a material ``of`` with its place, size, z, blend, opacity, shape and mask.
    background : float or material
        Friction below all sprites.
    """

    kind: Literal["composition"] = "composition"
    sprites: tuple[SpriteTable, ...] = ()
    background: NumberOrMaterial = 0.0

    @cached_property
    def evaluator(self) -> FrictionField:
        """A `haptix.texture.Composition`."""
        below = self.background
        sprites = [
            Sprite(
                field_of(sprite.of),
                **{name: value for name, value in sprite if name not in ("of", "mask")},
                mask=None if sprite.mask is None else field_of(sprite.mask),
            )
            for sprite in self.sprites
        ]
        return Composition(sprites, below if isinstance(below, float) else field_of(below))
