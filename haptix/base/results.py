"""Results, named by the hash of their inputs, in a folder or at a URL of fsspec.

results/ab/abcd.../    files of one result, then result.json: the hashes of all, and its own

A result counts only if every byte of it is as it was written. All of it is read before it is used
again; a file that was emptied, changed, swapped or removed is named, and the result is made again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from secrets import token_hex
from tempfile import TemporaryDirectory
from typing import Any

from filelock import FileLock, Timeout
from fsspec.core import url_to_fs

from haptix.base.errors import InputError
from haptix.base.files import Content, json_text, parse_json
from haptix.base.version import __version__

MANIFEST = "result.json"
_DRAFT = ".part"
# Stores that show an object only once it is complete.
WRITES_WHOLE = {"s3", "s3a", "gs", "gcs", "abfs", "abfss", "az", "adl", "memory", "r2", "oss"}


def result_key(task: str, document: Mapping[str, Any]) -> str:
    """Return the name of a result: the SHA-256 of its inputs."""
    text = json.dumps([__version__, task, document], sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def folder_of(key: str) -> str:
    """Return the folder of a result."""
    return f"results/{key[:2]}/{key}"


class ResultStore:
    """Files by their names within a place, results among them.

    Raises `InputError` if fsspec does not reach it.

    Parameters
    ----------
    where : str or Path
        A folder, or a URL of fsspec such as ``s3://bucket/campaign``.
    """

    def __init__(self, where: str | Path) -> None:
        self.is_local = "://" not in str(where)
        self.where = str(Path(where).absolute()) if self.is_local else str(where)
        try:
            self._system, root = url_to_fs(self.where)
        except (ImportError, ValueError) as error:
            raise InputError(f"{where}: expected a place that fsspec reaches: {error}") from None
        self._root = root.rstrip("/")
        protocol = self._system.protocol
        names = {protocol} if isinstance(protocol, str) else set(protocol)
        self._writes_whole = bool(names & WRITES_WHOLE)

    def _at(self, name: str) -> str:
        return f"{self._root}/{name}"

    def read(self, name: str) -> bytes | None:
        """Return a file's bytes, or None where there is none."""
        try:
            return bytes(self._system.cat_file(self._at(name)))
        except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
            return None

    def write(self, name: str, data: bytes) -> None:
        """Write a file whole; if that is interrupted, the old file stays."""
        path = self._at(name)
        if self._writes_whole:
            self._system.pipe_file(path, data)
            return
        folder, _, last = path.rpartition("/")
        self._system.makedirs(folder, exist_ok=True)
        draft = f"{folder}/.{last}.{token_hex(8)}{_DRAFT}"
        try:
            self._system.pipe_file(draft, data)
            self._system.mv(draft, path)
        except BaseException:
            with suppress(Exception):
                self._system.rm_file(draft)
            raise

    def read_table(self, name: str) -> dict[str, Any] | None:
        """Return a JSON file, or None where there is none or it is damaged."""
        with suppress(ValueError):
            table = parse_json(self.read(name) or b"null")
            return table if isinstance(table, dict) else None
        return None

    def write_table(self, name: str, table: Mapping[str, Any]) -> None:
        """Write a JSON file whole."""
        self.write(name, json_text(table).encode())

    def publish(self, key: str, files: Mapping[str, Content], about: Mapping[str, Any]) -> int:
        """Write a result's files, then its manifest; return all bytes.

        Parameters
        ----------
        key : str
            Its name.
        files : mapping
            By name: bytes, text, or a function that writes to a path.
        about : mapping
            Plain values for the manifest.
        """
        size, hashes = 0, {}
        for name, content in files.items():
            data = _bytes_of(name, content)
            hashes[name] = {"sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)}
            self.write(f"{folder_of(key)}/{name}", data)
            size += len(data)
        manifest = _signed({**about, "key": key, "files": hashes})
        self.write(f"{folder_of(key)}/{MANIFEST}", manifest)
        return size + len(manifest)

    def check(self, key: str) -> tuple[dict[str, Any] | None, str]:
        """Read every byte of a result.

        Returns
        -------
        dict or None
            Its manifest, where the result is whole.
        str
            Its error; empty where it is whole, or where there is none.
        """
        data = self.read(f"{folder_of(key)}/{MANIFEST}")
        if data is None:
            return None, ""
        manifest = None
        with suppress(ValueError):
            manifest = parse_json(data)
            if not (isinstance(manifest, dict) and _is_of_key(manifest, data, key)):
                manifest = None
        if not data:
            return None, f"{MANIFEST} is empty"
        if manifest is None:
            return None, f"{MANIFEST} was changed since it was written"
        for name, written in manifest["files"].items():
            data = self.read(f"{folder_of(key)}/{name}")
            if data is None:
                return None, f"{name} is missing"
            if hashlib.sha256(data).hexdigest() != written["sha256"]:
                return None, f"{name} {'was changed since it was written' if data else 'is empty'}"
        return manifest, ""

    def remove(self, key: str) -> None:
        """Remove a result."""
        with suppress(FileNotFoundError):
            self._system.rm(self._at(folder_of(key)), recursive=True)

    def kept(self) -> set[str]:
        """Keys of all results, complete or not."""
        try:
            files = map(PurePosixPath, self._system.find(self._at("results")))
        except FileNotFoundError:
            return set()
        return {path.parent.name for path in files if path.name == MANIFEST}

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Lock a folder against this machine's other processes; remove drafts of killed writers."""
        if not self.is_local:
            yield
            return
        try:
            self._system.makedirs(self._root, exist_ok=True)
            lock = FileLock(self._at("campaign.lock")).acquire(timeout=0)
        except Timeout:
            raise InputError(
                f"{self.where}: another campaign is at work here; wait for it, or name another "
                "--out"
            ) from None
        except OSError as error:
            why = error.strerror or error
            raise InputError(f"cannot write to {self.where}: {why}; name another --out") from None
        with lock:
            for draft in Path(self.where).rglob(f".*{_DRAFT}"):
                draft.unlink(missing_ok=True)
            yield


def _bytes_of(name: str, content: Content) -> bytes:
    if not callable(content):
        return content.encode() if isinstance(content, str) else bytes(content)
    with TemporaryDirectory(prefix="haptix-") as folder:
        content(path := Path(folder, name))
        return path.read_bytes()


def _signed(manifest: Mapping[str, Any]) -> bytes:
    """Return a manifest as bytes, with the hash of its other fields."""
    sha256 = hashlib.sha256(json_text(manifest).encode()).hexdigest()
    return json_text({**manifest, "sha256": sha256}).encode()


def _is_of_key(manifest: dict[str, Any], data: bytes, key: str) -> bool:
    """Whether a manifest has the bytes that were written for a key."""
    fields = {name: value for name, value in manifest.items() if name != "sha256"}
    return manifest.get("key") == key and _signed(fields) == data
