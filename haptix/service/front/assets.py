"""Files of apps, kept under the hash of their content: photographs, height maps, sounds.

Before the engine gets a layout, a worker of the session checks its files and decodes the pictures
(`Decoding`). So a file that unpacks to gigabytes ends only that worker, which renders no touch and
holds no other session's data.
"""

from __future__ import annotations

import asyncio
import filecmp
import os
import shutil
import tempfile
from collections.abc import AsyncIterator, Iterator
from hashlib import file_digest, sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from haptix.feel.materials.decoded import FOLDER, PICTURES, is_kept
from haptix.service.protocol.messages import Limits, Problem

if TYPE_CHECKING:
    from haptix.service.front.pool import Pool

SUFFIXES = (*PICTURES, ".wav", ".flac", ".csv", ".xml")


class AssetStore:
    """A folder of files named by their SHA-256; the engine reads them from there.

    Parameters
    ----------
    folder : Path
        Made if it does not exist; other users cannot read it.
    limits : Limits
        Largest size of one file and of all.
    """

    def __init__(self, folder: Path, limits: Limits | None = None) -> None:
        self.folder = folder
        self._limits = limits or Limits()
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)

    def keep(self, folder: Path) -> None:
        """Keep the files of a folder, whose names are their hashes."""
        for path in folder.iterdir():
            target = self.folder / path.name
            if not target.exists() or not filecmp.cmp(path, target, shallow=False):
                shutil.copyfile(path, target)

    def path(self, digest: str) -> Path:
        """Return where a file is.

        Raises `Problem` if the name is no hash, or nothing has it.
        """
        self._check(digest)
        for path in self.folder.glob(f"{digest}.*"):
            return path
        raise Problem("unknown", f"no asset has the hash {digest[:12]}...; send it first")

    async def put(self, digest: str, suffix: str, chunks: AsyncIterator[bytes]) -> bool:
        """Keep a file; return whether it is new.

        Raises `Problem` if it is too large, of a kind that nothing reads, or its content has
        another hash.
        """
        self._check(digest)
        if suffix not in SUFFIXES:
            raise Problem("document", f"expected one of {', '.join(SUFFIXES)}, got {suffix!r}")
        for kept in self.folder.glob(f"{digest}.*"):
            if await asyncio.to_thread(_is_whole, kept, digest):
                return False
            kept.unlink(missing_ok=True)
        room = self._limits.assets_bytes - sum(
            path.stat().st_size for path in self.folder.iterdir()
        )
        largest = min(self._limits.asset_bytes, room)
        content_hash, size = sha256(), 0
        handle, draft = tempfile.mkstemp(".part", ".asset.", self.folder)
        try:
            with os.fdopen(handle, "wb") as file:
                async for chunk in chunks:
                    size += len(chunk)
                    if size > largest:
                        raise Problem("limit", f"expected at most {largest} bytes")
                    content_hash.update(chunk)
                    file.write(chunk)
            if content_hash.hexdigest() != digest:
                raise Problem("document", f"the content has the hash {content_hash.hexdigest()}")
            Path(draft).replace(self.folder / f"{digest}{suffix}")
        finally:
            Path(draft).unlink(missing_ok=True)
        return True

    @staticmethod
    def _check(digest: str) -> None:
        if len(digest) != 64 or not set(digest) <= set("0123456789abcdef"):
            raise Problem("unknown", "expected 64 hexadecimal digits, the SHA-256 of the content")


def _is_whole(path: Path, digest: str) -> bool:
    """Whether a kept file has the content of its name."""
    try:
        with path.open("rb") as file:
            return file_digest(file, "sha256").hexdigest() == digest
    except OSError:
        return False


class Decoding:
    """Checks a message's files and decodes its pictures before the engine reads them.

    Parameters
    ----------
    assets : AssetStore
        The files.
    pool : Pool
        Decodes them.
    """

    def __init__(self, assets: AssetStore, pool: Pool) -> None:
        self._assets, self._pool = assets, pool
        self._folder = assets.folder.parent / FOLDER
        self._checked: set[str] = set()  # by digest

    async def __call__(self, owner: str, fields: dict[str, Any]) -> None:
        """Check the new assets in a message of an owner.

        Raises `Problem` with the place in the message of the file that cannot be read. The memory
        of the maps that the engine makes of them is counted there (`MapMemory`).
        """
        for path, digest in _named(fields, ""):
            try:
                file = self._assets.path(digest)
            except Problem:
                continue  # the engine's refusal names the region, too
            is_decoded = file.suffix not in PICTURES or is_kept(self._folder, digest)
            if digest not in self._checked or not is_decoded:
                try:
                    await self._pool.ask(owner, "decode", digest=digest)
                    self._checked.add(digest)
                except Problem as problem:
                    raise Problem(problem.code, problem.sentence, path) from None


def _named(value: Any, path: str) -> Iterator[tuple[str, str]]:
    """Yield where a file is named, and its hash."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _named(item, f"{path}/{key}")
    elif isinstance(value, list | tuple):
        for index, item in enumerate(value):
            yield from _named(item, f"{path}/{index}")
    elif isinstance(value, str) and value.startswith("sha256:"):
        yield path, value.removeprefix("sha256:")
