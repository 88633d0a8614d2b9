"""The messages of a session: JSON texts, each with a `type`.

A client's messages are numbered by `id`, which rises; each is answered once, with the same `id`.
`touch` and `pong` need none: only their errors are answered. The server's events have `id` 0.
Every field says since which version of the protocol it is there.
"""

from __future__ import annotations

import json
import re
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

PROTOCOL = (1, 0)
"""Version, major and minor. Another major is another language; a minor only adds."""

MOST_TEXT_BYTES = 64 * 1024
MOST_DEPTH = 16
MOST_TOUCHES = 1024  # of one batch
MOST_STREAM_HZ = 50

Code = Literal[
    "message",  # no message, or none of this protocol
    "version",
    "order",  # not now: before hello, or an id that does not rise
    "access",
    "lease",
    "clock",
    "limit",
    "document",
    "device",
    "unknown",  # what a message names is not there
    "internal",
]
"""What is wrong, for programs."""

Stream = Literal["stats"]
"""What a client can subscribe to."""

Id = Annotated[int, Field(ge=1, le=2**53)]
Name = Annotated[str, Field(min_length=1, max_length=100)]
Number = Annotated[float, Field(allow_inf_nan=False)]


class Message(BaseModel):
    """One message; unknown keys are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class Problem(Exception):
    """A message that is refused.

    Parameters
    ----------
    code : Code
        What is wrong, for programs.
    sentence : str
        What was expected, what came, and what to do.
    path : str
        Field, as a JSON pointer; "" for the whole message.
    """

    def __init__(self, code: Code, sentence: str, path: str = "") -> None:
        super().__init__(sentence)
        self.code, self.sentence, self.path = code, sentence, path


# --- from the client -----------------------------------------------------------------------------


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


class Geometry(Message):
    """Pixels to millimetres: ``mm = origin + turn(rotation) (px / px_per_mm)``."""

    type: Literal["geometry"]
    id: Id
    px_per_mm: Annotated[float, Field(gt=0, le=1e4, allow_inf_nan=False)]
    origin_mm: tuple[Number, Number] = (0.0, 0.0)
    rotation_deg: Number = 0.0


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
    touches: Annotated[tuple[TouchMessage, ...], Field(max_length=MOST_TOUCHES)]


class RegionFields(Message):
    """Where a region lies, and how it lies on what is below; see `haptix.Layout.add`."""

    x_mm: Number | None = None
    y_mm: Number | None = None
    width_mm: Annotated[float, Field(gt=0, le=1e4, allow_inf_nan=False)] | None = None
    height_mm: Annotated[float, Field(gt=0, le=1e4, allow_inf_nan=False)] | None = None
    shape: (
        Literal["rectangle", "ellipse"]
        | Annotated[tuple[tuple[Number, Number], ...], Field(min_length=3, max_length=256)]
        | None
    ) = None
    rotation_deg: Number | None = None
    scale: Annotated[float, Field(gt=0, le=1e4, allow_inf_nan=False)] | None = None
    z: Number | None = None
    blend: Literal["over", "add", "multiply", "max", "min"] | None = None
    opacity: Annotated[float, Field(ge=0, le=1)] | None = None
    priority: Annotated[int, Field(ge=-1000, le=1000)] | None = None


class RegionMessage(RegionFields):
    """A region: its name, its material's document, and where it lies."""

    name: Name
    material: dict[str, Any]


class LayoutDocument(Message):
    """All regions; beside them nothing is felt."""

    regions: Annotated[tuple[RegionMessage, ...], Field(max_length=256)]


class LayoutSet(Message):
    """Replace the layout of this session by a document."""

    type: Literal["layout_set"]
    id: Id
    document: LayoutDocument


class AddRegion(RegionMessage):
    """Add a region."""

    op: Literal["add"]


class ChangeRegion(RegionFields):
    """Change what is given of a region, in a cross-fade."""

    op: Literal["change"]
    name: Name
    material: dict[str, Any] | None = None


class MoveRegion(Message):
    """Move a region, in `over_s`."""

    op: Literal["move"]
    name: Name
    x_mm: Number | None = None
    y_mm: Number | None = None
    rotation_deg: Number | None = None
    over_s: Annotated[float, Field(ge=0, le=60)] = 0.02


class RemoveRegion(Message):
    """Remove a region; it fades out."""

    op: Literal["remove"]
    name: Name


Change = Annotated[AddRegion | ChangeRegion | MoveRegion | RemoveRegion, Field(discriminator="op")]


class LayoutChange(Message):
    """Change the layout of this session: all of `ops`, or nothing."""

    type: Literal["layout_change"]
    id: Id
    ops: Annotated[tuple[Change, ...], Field(min_length=1, max_length=256)]


class Play(Message):
    """Play an effect that ends, such as a transient, for all fingers."""

    type: Literal["play"]
    id: Id
    effect: dict[str, Any]


class Cancel(Message):
    """End an effect by the number that `playing` gave."""

    type: Literal["cancel"]
    id: Id
    effect_id: Annotated[int, Field(ge=1)]


class Intensity(Message):
    """Share of the asked friction, 0 to 1."""

    type: Literal["intensity"]
    id: Id
    value: Annotated[float, Field(ge=0, le=1)]


class Switch(Message):
    """Mute: 0 V while time runs. Pause: 0 V and time stands."""

    type: Literal["mute", "pause"]
    id: Id
    on: bool


class Subscribe(Message):
    """Streams that the client wants, each with its rate in hertz; 0 ends one."""

    type: Literal["subscribe"]
    id: Id
    streams: dict[
        Stream,
        Annotated[float, Field(ge=0, le=MOST_STREAM_HZ, allow_inf_nan=False)],
    ]


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
    | Pong,
    Field(discriminator="type"),
]
_CLIENT: TypeAdapter[Any] = TypeAdapter(ClientMessage)


# --- from the server -----------------------------------------------------------------------------


class Limits(Message):
    """What a session is held to."""

    text_bytes: int = MOST_TEXT_BYTES
    depth: int = MOST_DEPTH
    batch_touches: int = MOST_TOUCHES
    fingers: int = 10
    messages_per_s: int = 200
    batches_per_s: int = 1200
    touches_per_s: int = 12000
    regions: int = 256
    effects: int = 16
    asset_bytes: int = 32 * 2**20
    assets_bytes: int = 2**30
    image_pixels: int = 24_000_000


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
    """What the output does. `voltage_share` is of the highest voltage; volts are not told."""

    type: Literal["output"] = "output"
    id: int = 0
    state: Literal["off", "armed", "asleep", "failed"]
    device: str
    intensity: float
    muted: bool
    paused: bool
    reason: str


class DeviceMessage(Message):
    """A driver: its address, what it is, and the profile that belongs to it."""

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
    kinds: tuple[str, ...]


class Welcome(Message):
    """Answer to `hello`."""

    type: Literal["welcome"] = "welcome"
    id: int
    protocol: str
    server: str
    session: int
    resume: str
    limits: Limits = Limits()
    keep_alive: KeepAlive = KeepAlive()
    clock_s: float
    inventory: Inventory
    output: OutputMessage
    lease: Lease


class Done(Message):
    """What was asked is done."""

    type: Literal["done"] = "done"
    id: int


class LayoutReply(Message):
    """The layout's revision, and the sample from which it is played, where one plays."""

    type: Literal["layout"] = "layout"
    id: int
    revision: int
    sample: int | None


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


class ContactMessage(Message):
    """A finger entered, left, pressed or released a region, or crossed a detent."""

    type: Literal["contact"] = "contact"
    id: int = 0
    event: Literal["enter", "leave", "press", "release", "detent"]
    region: str
    touch_id: int
    t_s: float  # by the client's clock
    value: float | None = None


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
    """The server ends the session, and says why."""

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
    | PingMessage
    | WarningMessage
    | Error
    | Bye,
    Field(discriminator="type"),
]
_SERVER: TypeAdapter[Any] = TypeAdapter(ServerMessage)


def read_client(text: str) -> Any:
    """Return the client's message of a JSON text.

    Raises
    ------
    Problem
        With the field that is wrong.
    """
    if len(text) > MOST_TEXT_BYTES or len(text.encode()) > MOST_TEXT_BYTES:
        raise Problem("limit", f"expected at most {MOST_TEXT_BYTES} bytes of text")
    if _depth(text) > MOST_DEPTH:
        raise Problem("limit", f"expected a text of at most {MOST_DEPTH} nested brackets")
    try:
        return _CLIENT.validate_json(text)
    except ValidationError as error:
        raise _problem(error) from None


def read_server(text: str) -> Any:
    """Return the server's message of a JSON text: what a client in Python reads."""
    return _SERVER.validate_json(text)


def id_of(text: str) -> int:
    """Return the id of a message that was refused, 0 where it has none."""
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        return 0
    number = found.get("id") if isinstance(found, dict) else None
    return number if type(number) is int and 1 <= number <= 2**53 else 0


def schema() -> dict[str, Any]:
    """Return the JSON Schema of all messages, from which the clients' types are made."""
    from pydantic.json_schema import models_json_schema

    client = _CLIENT.json_schema(ref_template="#/$defs/{model}")
    server = _SERVER.json_schema(ref_template="#/$defs/{model}", mode="serialization")
    extra = models_json_schema([(TouchMessage, "validation")], ref_template="#/$defs/{model}")[1]
    parts = client.pop("$defs") | server.pop("$defs") | extra["$defs"]
    text = json.dumps({name: parts[name] for name in sorted(parts)})
    # Clients call a HelloMessage a Hello; here the name is that of another class.
    named = json.loads(re.sub(r'(?<=[A-Za-z])Message"', '"', text))
    both = {"ClientMessage": client, "ServerMessage": server}
    both = json.loads(re.sub(r'(?<=/)([A-Za-z]+)Message"', r'\1"', json.dumps(both)))
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"haptix session {PROTOCOL[0]}.{PROTOCOL[1]}",
        "$defs": named | both,
    }


def _depth(text: str) -> int:
    """Return how deep brackets nest, outside of strings."""
    deepest = depth = 0
    inside = escaped = False
    for letter in text:
        if inside:
            if escaped:
                escaped = False
            elif letter == "\\":
                escaped = True
            elif letter == '"':
                inside = False
        elif letter == '"':
            inside = True
        elif letter in "[{":
            depth += 1
            deepest = max(deepest, depth)
        elif letter in "]}":
            depth -= 1
    return deepest


def _problem(error: ValidationError) -> Problem:
    """Return the first of pydantic's complaints, with a pointer into the client's text."""
    first = error.errors(include_url=False)[0]
    kind, place = first["type"], list(first["loc"])
    if kind == "json_invalid":
        return Problem("message", f"expected a JSON text: {first['ctx']['error']}")
    if kind in ("union_tag_not_found", "model_attributes_type", "dict_type"):
        return Problem("message", "expected an object with the key type", "/type")
    if kind == "union_tag_invalid":
        return Problem(
            "message", f"unknown type: expected one of {first['ctx']['expected_tags']}", "/type"
        )
    path = "".join(f"/{_pointer(part)}" for part in place[1:])  # the first is the type
    if kind == "extra_forbidden":
        return Problem("message", f"unknown key {place[-1]!r}", path)
    got = json.dumps(first["input"], default=str) if kind != "missing" else "nothing"
    got = got if len(got) <= 80 else got[:77] + "..."
    return Problem("message", f"{place[-1]}: {first['msg'].lower()}, got {got}", path)


def _pointer(part: Any) -> str:
    return str(part).replace("~", "~0").replace("/", "~1")
