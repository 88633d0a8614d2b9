"""Files of layouts are looked at by the maker before the engine hears of them.

It decodes the pictures. A file that unpacks to gigabytes ends a process that nobody's touch needs.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from haptix.service.assets import AssetStore
from haptix.service.maker import Maker
from haptix.service.messages import Problem
from haptix.texture.decoded import is_kept

FOLDER = "decoded"
"""Beside the folder of assets."""
PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
MOST_BYTES = 4 * 2**30
"""Memory of the files of all sessions' layouts in the engine."""


class Decoding:
    """Sees to it that the engine can read a message's files: pictures are decoded, others short.

    Parameters
    ----------
    assets : AssetStore
        The files.
    maker : Maker
        Decodes them.
    layouts : callable
        Returns the documents that the engine has.
    """

    def __init__(
        self,
        assets: AssetStore,
        maker: Maker,
        layouts: Callable[[], Iterable[dict[str, Any]]] = tuple,
    ) -> None:
        self._assets, self._maker, self._layouts = assets, maker, layouts
        self._folder = assets.folder.parent / FOLDER
        self._bytes: dict[str, int] = {}  # of memory, by digest

    async def __call__(self, fields: dict[str, Any]) -> None:
        """Look at what is new.

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
                    self._bytes[digest] = (await self._maker.ask("decode", digest=digest))["bytes"]
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
