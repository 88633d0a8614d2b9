"""Pictures of layouts are decoded by the maker before the engine hears of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from haptix.service.assets import AssetStore
from haptix.service.maker import Maker
from haptix.service.messages import Problem
from haptix.texture.decoded import is_kept

FOLDER = "decoded"
"""Beside the folder of assets."""
PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")


class Decoding:
    """Sees to it that the pixels of all pictures of a message are there.

    Parameters
    ----------
    assets : AssetStore
        The files.
    maker : Maker
        Decodes them.
    """

    def __init__(self, assets: AssetStore, maker: Maker) -> None:
        self._assets, self._maker = assets, maker
        self._folder = assets.folder.parent / FOLDER

    async def __call__(self, fields: dict[str, Any]) -> None:
        """Decode what is not decoded yet.

        Raises
        ------
        Problem
            Pointing to the picture that cannot be, in the message.
        """
        for path, digest in _named(fields, ""):
            try:
                file = self._assets.path(digest)
            except Problem:
                continue  # the engine says so, with the region
            if file.suffix not in PICTURES or is_kept(self._folder, digest):
                continue
            try:
                await self._maker.ask("decode", digest=digest)
            except Problem as problem:
                raise Problem(problem.code, problem.sentence, path) from None


def _named(value: Any, path: str) -> Iterator[tuple[str, str]]:
    """Where files are named, and their hashes."""
    if isinstance(value, dict):
        for key, one in value.items():
            yield from _named(one, f"{path}/{key}")
    elif isinstance(value, list | tuple):
        for index, one in enumerate(value):
            yield from _named(one, f"{path}/{index}")
    elif isinstance(value, str) and value.startswith("sha256:"):
        yield path, value.removeprefix("sha256:")
