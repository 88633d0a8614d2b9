"""What a client sends."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from haptix.region import Number, PixelPlaces, Place, RegionFields
from haptix.service.messages.base import (
    MOST_STREAM_HZ,
    MOST_TOUCHES,
    Id,
    Message,
    Name,
    Stream,
)


class HelloMessage(Message):
    """First message: who comes, in which version."""

    type: Literal["hello"]
    id: Id
    protocol: Annotated[str, Field(pattern=r"^[0-9]{1,4}\.[0-9]{1,4}$")]
    client: Name
    token: Annotated[str, Field(max_length=200)] = ""
    resume: Annotated[str, Field(max_length=200)] = ""


class Acquire(Message):
    """Ask for the lease on the output; with `takeover` also from who holds it."""

    type: Literal["acquire"]
    id: Id
    takeover: bool = False


class Plain(Message):
    """A message without fields."""

    type: Literal["release", "arm", "disarm", "stop", "inventory", "bye"]
    id: Id


class Geometry(PixelPlaces, Message):
    """Say how pixels become mm: ``origin_mm + turn(rotation_deg) (px / px_per_mm)``."""

    type: Literal["geometry"]
    id: Id


class TouchMessage(Message):
    """One report of one finger; its place is in millimetres or in pixels."""

    t_s: Number
    touch_id: Annotated[int, Field(ge=0, le=255)] = 0
    kind: Literal["down", "move", "up"] = "move"
    x_mm: Number | None = None
    y_mm: Number | None = None
    x_px: Number | None = None
    y_px: Number | None = None
    normal_force_n: Annotated[float, Field(gt=0, le=100, allow_inf_nan=False)] | None = None
    contact_area_m2: Annotated[float, Field(gt=0, le=0.1, allow_inf_nan=False)] | None = None


class TouchesMessage(Message):
    """Touches as JSON; many are better sent as a batch of bytes."""

    type: Literal["touch"]
    id: Id | None = None
    touches: Annotated[tuple[TouchMessage, ...], Field(max_length=MOST_TOUCHES, fail_fast=True)]


class RegionDocument(RegionFields, Message):
    """A region: its name, its material's document, and where it lies."""

    name: Name
    material: dict[str, Any]


class LayoutDocument(Message):
    """All regions; beside them nothing is felt."""

    regions: Annotated[tuple[RegionDocument, ...], Field(max_length=256, fail_fast=True)]


class LayoutSet(Message):
    """Replace the layout of this session by a document."""

    type: Literal["layout_set"]
    id: Id
    document: LayoutDocument


class AddRegion(RegionDocument):
    """Add a region."""

    op: Literal["add"]


class ChangeRegion(RegionFields, Message):
    """Change what is given of a region, in a cross-fade."""

    op: Literal["change"]
    name: Name
    material: dict[str, Any] | None = None


class MoveRegion(Place, Message):
    """Move a region within `over_s`; what is left out stays."""

    op: Literal["move"]
    name: Name
    over_s: Annotated[float, Field(ge=0, le=60)] = 0.02


class RemoveRegion(Message):
    """Remove a region; it fades out."""

    op: Literal["remove"]
    name: Name


class SetValue(Message):
    """Set the value of a control, such as a slider; it comes after all other changes."""

    op: Literal["value"]
    name: Name
    value: Annotated[float, Field(ge=0, le=1)]


Change = Annotated[
    AddRegion | ChangeRegion | MoveRegion | RemoveRegion | SetValue, Field(discriminator="op")
]


class LayoutChange(Message):
    """Change the layout of this session: all of `ops`, or nothing."""

    type: Literal["layout_change"]
    id: Id
    ops: Annotated[tuple[Change, ...], Field(min_length=1, max_length=256, fail_fast=True)]


class Play(Message):
    """Play an effect that ends, such as a transient; `effect_ended` tells its end."""

    type: Literal["play"]
    id: Id
    effect: dict[str, Any]


class Cancel(Message):
    """End an effect by the number that `playing` gave."""

    type: Literal["cancel"]
    id: Id
    effect_id: Annotated[int, Field(ge=1)]


class Intensity(Message):
    """Set the share of friction that is asked for, 0 to 1."""

    type: Literal["intensity"]
    id: Id
    value: Annotated[float, Field(ge=0, le=1)]


class Switch(Message):
    """Mute: 0 V while time runs. Pause: 0 V and time stands. Sense: by the current, once armed."""

    type: Literal["mute", "pause", "sense"]
    id: Id
    on: bool


class Subscribe(Message):
    """Ask for streams, each with its highest rate in hertz; 0 ends one."""

    type: Literal["subscribe"]
    id: Id
    streams: dict[
        Stream,
        Annotated[float, Field(ge=0, le=MOST_STREAM_HZ, allow_inf_nan=False)],
    ]


class Watch(Message):
    """Ask how far a job is, and be told of its changes until it ends."""

    type: Literal["watch"]
    id: Id
    job: Name


class Pong(Message):
    """Answer to `ping`: its number, and the client's own clock."""

    type: Literal["pong"]
    n: Annotated[int, Field(ge=0)]
    clock_s: Number


ClientMessage = Annotated[
    HelloMessage
    | Acquire
    | Plain
    | Geometry
    | TouchesMessage
    | LayoutSet
    | LayoutChange
    | Play
    | Cancel
    | Intensity
    | Switch
    | Subscribe
    | Watch
    | Pong,
    Field(discriminator="type"),
]
