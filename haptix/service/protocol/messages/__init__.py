"""The messages of a session: JSON texts, each with a `type`.

A client's messages are numbered by `id`, which rises; each is answered once, with the same `id`.
`touch` and `pong` need none: only their errors are answered. The server's events have `id` 0.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from haptix.base.fields import ContactArea, JsonObject, TouchForce
from haptix.base.files import checked_values
from haptix.feel.layout.region import Number, PixelPlaces, Place, RegionFields

PROTOCOL = (1, 0)
"""Version, major and minor. Another major is another language; a minor only adds."""

MOST_TEXT_BYTES, MOST_HELLO_BYTES = 2**20, 4096
"""Of a message, such as 256 regions of 4 KiB; of those before a client has shown its token."""
COUNTED_BYTES = 4096  # a text counts as one message more for each
MOST_DEPTH, MOST_KEYS, MOST_LISTS, MOST_VALUES = 16, 16_384, 32_768, 100_000
"""Of a text. Those of 256 regions have 8,000 keys; 20,000 touches by columns have 80,000 values. To
refuse 500,000 values took 6 s, in which nobody's STOP was read."""
MOST_TOUCHES = 1024  # of one batch
SCREEN_MM = 500.0  # of a screen whose profile has no size: larger than any
MOST_STREAM_HZ = 1000

Code = Literal[
    "message",  # no message, or none of this protocol
    "version",
    "order",  # not now: before hello, or an id that does not rise
    "stale",  # made from something that another has changed since
    "access",
    "lease",
    "clock",
    "limit",
    "document",
    "device",
    "unknown",  # a message names a thing that does not exist
    "internal",
]
"""Error codes, for programs."""

Stream = Literal["stats", "friction", "felt"]
"""Streams that a client can subscribe to."""

Id = Annotated[int, Field(ge=1, le=2**53)]
Count = Annotated[int, Field(ge=0, le=2**53)]
# What a message carries goes on to the engine, which all clients share: texts and numbers that its
# reader refuses are refused here.
Name = Annotated[str, Field(min_length=1, max_length=100), AfterValidator(checked_values)]
Word = Annotated[str, Field(max_length=200), AfterValidator(checked_values)]


class Message(BaseModel):
    """One message; unknown keys are errors."""

    # Built at their first use: the engine and other processes use none.
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, defer_build=True)


class Problem(Exception):
    """A message that is refused.

    Parameters
    ----------
    code : Code
        The error code, for programs.
    sentence : str
        The expected value, the received one, and the remedy.
    path : str
        Field, as a JSON pointer; "" for the whole message.
    """

    def __init__(self, code: Code, sentence: str, path: str = "") -> None:
        super().__init__(sentence)
        self.code, self.sentence, self.path = code, sentence, path


# --- messages of a client ------------------------------------------------------------------------


class HelloMessage(Message):
    """First message: who comes, in which version."""

    type: Literal["hello"]
    id: Id
    protocol: Annotated[str, Field(pattern=r"^[0-9]{1,4}\.[0-9]{1,4}$")]
    client: Name
    token: Word = ""
    resume: Word = ""
    """Of the last `welcome` in this run: lease and layout are the session's again."""
    app: Word = ""
    """A word that only this app knows, the same at each start: after a crash the lease is its own
    again, with an empty layout."""


class Acquire(Message):
    """Ask for the lease on the output; with `takeover` also from who holds it."""

    type: Literal["acquire"]
    id: Id
    takeover: bool = False


class Plain(Message):
    """A message without fields."""

    type: Literal["release", "arm", "stop", "inventory", "bye"]
    id: Id


class Geometry(PixelPlaces, Message):
    """Map pixels to mm: ``origin_mm + turn(rotation_deg) (px / px_per_mm)``."""

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
    normal_force_n: TouchForce | None = None
    contact_area_m2: ContactArea | None = None

    @model_validator(mode="before")
    @classmethod
    def _lifted(cls, fields: Any) -> Any:
        """Drop the force and area of a finger that is off, such as a page's pressure of 0."""
        if isinstance(fields, dict) and fields.get("kind") == "up":
            return fields | {"normal_force_n": None, "contact_area_m2": None}
        return fields


class TouchesMessage(Message):
    """Touches as JSON; many are better sent as a batch of bytes."""

    type: Literal["touch"]
    id: Id | None = None
    touches: Annotated[tuple[TouchMessage, ...], Field(max_length=MOST_TOUCHES, fail_fast=True)]


class RegionDocument(RegionFields, Message):
    """A region: its name, its material's document, and where it lies."""

    name: Name
    material: JsonObject


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
    """Change the given fields of a region, in a cross-fade."""

    op: Literal["change"]
    name: Name
    material: JsonObject | None = None


class MoveRegion(Place, Message):
    """Move a region within `over_s`; fields that are left out stay."""

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
    """Play an effect that ends, such as a transient; `effect_ended` reports its end."""

    type: Literal["play"]
    id: Id
    effect: JsonObject


class Cancel(Message):
    """End an effect by the number that `playing` gave."""

    type: Literal["cancel"]
    id: Id
    effect_id: Id


class Intensity(Message):
    """Set the share of friction that is asked for, 0 to 1."""

    type: Literal["intensity"]
    id: Id
    value: Annotated[float, Field(ge=0, le=1)]


class Switch(Message):
    """Mute: 0 V while time runs. Pause: 0 V and time stands. Sense: by the current, once armed."""

    type: Literal["mute", "pause", "sense"]
    id: Id
    on: bool = True


class Subscribe(Message):
    """Ask for streams, each with its highest rate in hertz; 0 ends one."""

    type: Literal["subscribe"]
    id: Id
    streams: dict[Stream, Annotated[float, Field(ge=0, le=MOST_STREAM_HZ, allow_inf_nan=False)]]


class Watch(Message):
    """Request the progress of a job, and its changes until it ends."""

    type: Literal["watch"]
    id: Id
    job: Name


class Pong(Message):
    """Answer to `ping`: its number, and the client's own clock."""

    type: Literal["pong"]
    n: Count
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


# --- messages of the server ----------------------------------------------------------------------


class Limits(Message):
    """Limits of a session."""

    text_bytes: int = MOST_TEXT_BYTES
    depth: int = MOST_DEPTH
    batch_touches: int = MOST_TOUCHES
    fingers: int = 10
    messages_per_s: int = 200
    batches_per_s: int = 1200
    touches_per_s: int = 12000
    regions: int = 256
    effects: int = 8
    asset_bytes: int = 32 * 2**20
    assets_bytes: int = 2**30
    image_pixels: int = 24_000_000  # those kept of a picture, which may have up to 200 000 000


class KeepAlive(Message):
    """How often the server pings [s], and what becomes of a client that does not answer."""

    armed_s: float = 0.1
    idle_s: float = 2.0
    silent_s: float = 0.4  # without an answer to a ping: then 0 V; the next pong wakes
    free_s: float = 30.0  # then the lease is free
    close_s: float = 60.0  # then the socket is closed


class Lease(Message):
    """Who holds the output."""

    type: Literal["lease"] = "lease"
    id: int = 0
    holder: int | None
    is_mine: bool
    reason: str


class OutputMessage(Message):
    """State of the output. `intensity`, `muted` and `paused` are its holder's.

    `failed`: the driver or the engine failed, and `arm` may be tried. `gone`: the driver does not
    answer, and is looked for. `back`: it was opened again, and a person arms it; a virtual one is
    armed by itself.

    While a job plays, `lent_to` is its kind, and `state` is that of all others: off.
    """

    type: Literal["output"] = "output"
    id: int = 0
    state: Literal["off", "armed", "asleep", "failed", "gone", "back"]
    device: str
    intensity: float
    muted: bool
    paused: bool
    senses: bool = False  # learns the finger by the current that it draws, from the next arm on
    person_intensity: float = 1.0  # the person's own, whichever app holds the output
    person_muted: bool = False
    lent_to: str = ""
    reason: str


class DeviceMessage(Message):
    """A driver: its address, its description, and its profile."""

    address: str
    name: str
    is_real: bool


class Inventory(Message):
    """All there is, whole each time."""

    type: Literal["inventory"] = "inventory"
    id: int = 0
    devices: tuple[DeviceMessage, ...]
    finger: str
    screen: str
    screen_mm: tuple[float, float] = (SCREEN_MM, SCREEN_MM)
    kinds: tuple[str, ...]


class Welcome(Message):
    """Answer to `hello`."""

    type: Literal["welcome"] = "welcome"
    id: int
    protocol: str
    server: str
    session: int
    resume: str
    limits: Limits = Field(default_factory=Limits)
    keep_alive: KeepAlive = Field(default_factory=KeepAlive)
    clock_s: float
    inventory: Inventory
    output: OutputMessage
    lease: Lease


class Done(Message):
    """The request was carried out."""

    type: Literal["done"] = "done"
    id: int


class LayoutReply(Message):
    """The layout's revision."""

    type: Literal["layout"] = "layout"
    id: int
    revision: int


class PlayingMessage(Message):
    """An effect has begun; `effect_ended` follows with the same number."""

    type: Literal["playing"] = "playing"
    id: int
    effect_id: int


class EffectEnded(Message):
    """An effect has ended: played whole, cut, or dropped."""

    type: Literal["effect_ended"] = "effect_ended"
    id: int = 0
    effect_id: int
    how: Literal["played", "cut", "dropped"]
    sample: int
    felt_share: float = 1.0  # of its length that was played with a finger on the screen


class ContactMessage(Message):
    """A finger entered, left, pressed or released a region, or crossed a detent."""

    type: Literal["contact"] = "contact"
    id: int = 0
    event: Literal["enter", "leave", "press", "release", "detent"]
    region: str
    touch_id: int
    t_s: float  # by the client's clock
    value: float | None = None  # number of the detent, from 0


class Subscribed(Message):
    """The columns of each stream that is sent."""

    type: Literal["subscribed"] = "subscribed"
    id: int
    columns: dict[str, tuple[str, ...]]


class PingMessage(Message):
    """Asks for a `pong` at once."""

    type: Literal["ping"] = "ping"
    id: int = 0
    n: int
    clock_s: float


class StrokeTrace(Message):
    """Readings of a calibration's instruments in a stroke since the last such message."""

    stroke: int
    tries: int
    """Attempts at this stroke before."""
    asked_normal_force_n: float
    asked_speed_mm_per_s: float
    t_s: tuple[float, ...]
    normal_force_n: tuple[float, ...]
    tangential_force_n: tuple[float, ...]
    speed_mm_per_s: tuple[float, ...]


class JobMessage(Message):
    """A job: its progress, its question, its error or its result."""

    type: Literal["job"] = "job"
    id: int = 0
    job: str
    kind: str
    state: Literal["queued", "running", "asking", "done", "failed", "cancelled"]
    share: float = 0.0
    prompt: str = ""
    choices: tuple[str, ...] = ()
    sentence: str = ""
    step: str = ""
    """The current step, of a job in steps."""
    trace: StrokeTrace | None = None
    """Only in the message that reports it."""
    result: dict[str, Any] | None = None


class WarningMessage(Message):
    """Something that needs no answer but a look."""

    type: Literal["warning"] = "warning"
    id: int = 0
    sentence: str


class Error(Message):
    """A message was refused, and nothing changed by it."""

    type: Literal["error"] = "error"
    id: int
    code: Code
    sentence: str
    path: str = ""


class Bye(Message):
    """The server ends the session, with the reason."""

    type: Literal["bye"] = "bye"
    id: int = 0
    reason: str


ServerMessage = Annotated[
    Welcome
    | Lease
    | OutputMessage
    | Inventory
    | Done
    | LayoutReply
    | PlayingMessage
    | EffectEnded
    | ContactMessage
    | Subscribed
    | JobMessage
    | PingMessage
    | WarningMessage
    | Error
    | Bye,
    Field(discriminator="type"),
]
