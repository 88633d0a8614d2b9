"""The messages of a session: JSON texts, each with a `type`.

A client's messages are numbered by `id`, which rises; each is answered once, with the same `id`.
`touch` and `pong` need none: only their errors are answered. The server's events have `id` 0.
Every field says since which version of the protocol it is there.
"""

from haptix.service.messages.base import *  # noqa: F403
from haptix.service.messages.from_client import *  # noqa: F403
from haptix.service.messages.from_server import *  # noqa: F403
from haptix.service.messages.reading import asyncapi as asyncapi
from haptix.service.messages.reading import build as build
from haptix.service.messages.reading import id_of as id_of
from haptix.service.messages.reading import read_client as read_client
from haptix.service.messages.reading import read_server as read_server
from haptix.service.messages.reading import schema as schema
from haptix.service.messages.reading import too_many as too_many
