"""Files of apps, kept under the hash of their content: photographs, height maps, sounds."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import AsyncIterator
from hashlib import sha256
from pathlib import Path

from haptix.service.messages import Limits, Problem

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".wav", ".flac", ".csv", ".xml")


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
            if not target.exists():
                shutil.copyfile(path, target)

    def path(self, digest: str) -> Path:
        """Return where a file is.

        Raises
        ------
        Problem
            If the name is no hash, or nothing has it.
        """
        self._check(digest)
        for found in self.folder.glob(f"{digest}.*"):
            return found
        raise Problem("unknown", f"no asset has the hash {digest[:12]}...; send it first")

    async def put(self, digest: str, suffix: str, chunks: AsyncIterator[bytes]) -> bool:
        """Keep a file; return whether it is new.

        Raises
        ------
        Problem
            If it is too large, of a kind that nothing reads, or its content has another hash.
        """
        self._check(digest)
        if suffix not in SUFFIXES:
            raise Problem("document", f"expected one of {', '.join(SUFFIXES)}, got {suffix!r}")
        if list(self.folder.glob(f"{digest}.*")):
            return False
        room = self._limits.assets_bytes - sum(
            found.stat().st_size for found in self.folder.iterdir()
        )
        largest = min(self._limits.asset_bytes, room)
        found, size = sha256(), 0
        handle, draft = tempfile.mkstemp(dir=self.folder)
        try:
            with os.fdopen(handle, "wb") as file:
                async for chunk in chunks:
                    size += len(chunk)
                    if size > largest:
                        raise Problem("limit", f"expected at most {largest} bytes")
                    found.update(chunk)
                    file.write(chunk)
            if found.hexdigest() != digest:
                raise Problem("document", f"the content has the hash {found.hexdigest()}")
            Path(draft).replace(self.folder / f"{digest}{suffix}")
        finally:
            Path(draft).unlink(missing_ok=True)
        return True

    @staticmethod
    def _check(digest: str) -> None:
        if len(digest) != 64 or not set(digest) <= set("0123456789abcdef"):
            raise Problem("unknown", "expected 64 hexadecimal digits, the SHA-256 of the content")
