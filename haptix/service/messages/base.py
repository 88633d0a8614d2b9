"""What all messages share: version, limits, codes, and the refusal."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

PROTOCOL = (1, 0)
"""Version, major and minor. Another major is another language; a minor only adds."""

MOST_TEXT_BYTES, MOST_HELLO_BYTES = 2**20, 4096
"""Of a message, such as 256 regions of 4 KiB; of those before a client has shown its token."""
COUNTED_BYTES = 4096  # a text counts as one message more for each
MOST_DEPTH, MOST_KEYS, MOST_LISTS, MOST_VALUES = 16, 16_384, 32_768, 100_000
"""Of a text. Those of 256 regions have 8,000 keys; 20,000 touches by columns have 80,000 values. To
refuse 500,000 values took 6 s, in which nobody's STOP was read."""
MOST_TOUCHES = 1024  # of one batch
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
    "unknown",  # what a message names is not there
    "internal",
]
"""What is wrong, for programs."""

Stream = Literal["stats", "friction", "felt"]
"""What a client can subscribe to."""

Id = Annotated[int, Field(ge=1, le=2**53)]
Name = Annotated[str, Field(min_length=1, max_length=100)]


class Message(BaseModel):
    """One message; unknown keys are errors."""

    # Built at their first use: the engine and other processes use none.
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, defer_build=True)


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
