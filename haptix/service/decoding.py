"""Files of layouts are looked at by a worker of their session before the engine hears of them.

It decodes the pictures. A file that unpacks to gigabytes ends a process that nobody's touch needs,
and in which nobody else's data is.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from haptix.service.assets import AssetStore
from haptix.service.messages import Problem
from haptix.service.pool import Pool
from haptix.texture.decoded import FOLDER, PICTURES, is_kept

MOST_BYTES = 4 * 2**30
"""Memory of the files of all sessions' layouts in the engine."""


class Decoding:
    """Sees to it that the engine can read a message's files: pictures are decoded, others short.

    Parameters
    ----------
    assets : AssetStore
        The files.
    pool : Pool
        Decodes them.
    layouts : callable
        Returns the documents that the engine has.
    """

    def __init__(
        self,
        assets: AssetStore,
        pool: Pool,
        layouts: Callable[[], Iterable[dict[str, Any]]] = tuple,
    ) -> None:
        self._assets, self._pool, self._layouts = assets, pool, layouts
        self._folder = assets.folder.parent / FOLDER
        self._bytes: dict[str, int] = {}  # of memory, by digest

    async def __call__(self, owner: str, fields: dict[str, Any]) -> None:
        """Look at what is new in a message of an owner.

        Raises
        ------
        Problem
            Pointing to the file that cannot be, in the message.
        """
        textures = {
            (digest, use): self._bytes.get(digest, 0)
            for document in self._layouts()
            for _, digest, use in _named(document, "")
        }
        for path, digest, use in _named(fields, ""):
            try:
                file = self._assets.path(digest)
            except Problem:
                continue  # the engine says so, with the region
            is_decoded = file.suffix not in PICTURES or is_kept(self._folder, digest)
            if digest not in self._bytes or not is_decoded:
                try:
                    found = await self._pool.ask(owner, "decode", digest=digest)
                    self._bytes[digest] = found["bytes"]
                except Problem as problem:
                    raise Problem(problem.code, problem.sentence, path) from None
            textures[digest, use] = self._bytes[digest]
            if sum(textures.values()) > MOST_BYTES:
                why = (
                    f"the files of all layouts would take {sum(textures.values()) / 2**30:.3g} GiB "
                    f"of memory; expected at most {MOST_BYTES / 2**30:g}: use smaller ones"
                )
                raise Problem("limit", why, path)


def _named(value: Any, path: str, of: Any = None) -> Iterator[tuple[str, str, str]]:
    """Where files are named, their hashes, and what names them: the same use is made once."""
    if isinstance(value, dict):
        for key, one in value.items():
            yield from _named(one, f"{path}/{key}", value)
    elif isinstance(value, list | tuple):
        for index, one in enumerate(value):
            yield from _named(one, f"{path}/{index}", of)
    elif isinstance(value, str) and value.startswith("sha256:"):
        yield path, value.removeprefix("sha256:"), json.dumps(of, sort_keys=True, default=str)
