"""What the server sends."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from haptix.service.messages.base import MOST_DEPTH, MOST_TEXT_BYTES, MOST_TOUCHES, Code, Message


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
    """What the output does. `intensity`, `muted` and `paused` are its holder's.

    While a job plays, `lent_to` is its kind, and `state` is that of all others: off.
    """

    type: Literal["output"] = "output"
    id: int = 0
    state: Literal["off", "armed", "asleep", "failed"]
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
    limits: Limits = Field(default_factory=Limits)
    keep_alive: KeepAlive = Field(default_factory=KeepAlive)
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
    """What a calibration's instruments read of a stroke, since they were told of last."""

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
    """A job: how far it is, what it asks, why it failed, or what it found."""

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
    """What it does, of a job in steps."""
    trace: StrokeTrace | None = None
    """Only in the message that tells of it."""
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
    | JobMessage
    | PingMessage
    | WarningMessage
    | Error
    | Bye,
    Field(discriminator="type"),
]
