"""Where a campaign is kept: a folder of this machine, or a place that fsspec reaches.

campaign.json             plan, versions
results/ab/abcd.../       one task's files, then result.json: the pure part, byte for byte
runs/ab/abcd....json      what its run cost, where, how often it began, or why it failed
table.csv, report.html    of all tasks
"""

from __future__ import annotations

import hashlib
import shutil
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from secrets import token_hex
from tempfile import TemporaryDirectory
from typing import Any

from haptix.errors import InputError, from_extra
from haptix.files import Content, json_text, parse_json, write_folder

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

MANIFEST = "result.json"
_DRAFT = ".part"
# An object appears here only once all of it is there.
_WHOLE = {"s3", "s3a", "gs", "gcs", "abfs", "abfss", "az", "adl", "memory", "r2", "oss"}


def folder_of(key: str) -> str:
    """Return the folder of a task's results."""
    return f"results/{key[:2]}/{key}"


def record_of(key: str) -> str:
    """Return the file of a task's run."""
    return f"runs/{key[:2]}/{key}.json"


class Store(ABC):
    """Files by their names within a place."""

    where: str

    @abstractmethod
    def read(self, name: str) -> bytes | None:
        """Return a file's bytes, or None where there is none."""

    @abstractmethod
    def write(self, name: str, data: bytes) -> None:
        """Write a file whole; an interrupted one leaves what was there before."""

    @abstractmethod
    def publish(self, key: str, files: Mapping[str, Content], result: Mapping[str, Any]) -> int:
        """Write a task's files, then its `MANIFEST` with their hashes; return all bytes.

        Two workers may do it at once: where a client was killed, its workers finish what they do.
        """

    @abstractmethod
    def finished(self) -> set[str]:
        """Keys of all tasks whose results are whole."""

    @contextmanager
    def held(self) -> Iterator[None]:
        """Keep other campaigns out, where the place can."""
        yield

    def read_table(self, name: str) -> dict[str, Any] | None:
        """Return a JSON file, or None where there is none or it is damaged."""
        data = self.read(name)
        with suppress(ValueError):
            found = None if data is None else parse_json(data)
            return found if isinstance(found, dict) else None
        return None

    def write_table(self, name: str, table: Mapping[str, Any]) -> None:
        """Write a JSON file whole."""
        self.write(name, json_text(table).encode())


class Folder(Store):
    """A folder that the operating system reaches."""

    def __init__(self, where: str | Path) -> None:
        self.path = Path(where).absolute()
        self.where = str(self.path)

    @contextmanager
    def held(self) -> Iterator[None]:
        """Keep other campaigns of this machine out; the system lets go where this one dies."""
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            file = (self.path / "campaign.lock").open("w")
        except OSError as error:
            why = error.strerror or error
            raise InputError(f"cannot write to {self.where}: {why}; name another --out") from None
        with file:
            if fcntl is not None:
                try:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except OSError:
                    raise InputError(
                        f"{self.where}: another campaign is at work here; wait for it, or name "
                        "another --out"
                    ) from None
            self._remove_drafts()
            yield
            self._remove_drafts()

    def _remove_drafts(self) -> None:
        """Remove what killed workers left; nobody but an orphaned worker writes any."""
        for within in ("results/*", "results/*/*", "runs/*"):
            for draft in self.path.glob(f"{within}/.*{_DRAFT}"):
                if draft.is_dir():
                    shutil.rmtree(draft, ignore_errors=True)
                else:
                    draft.unlink(missing_ok=True)

    def read(self, name: str) -> bytes | None:
        """Return a file's bytes, or None where there is none."""
        try:
            return (self.path / name).read_bytes()
        except FileNotFoundError:
            return None

    def write(self, name: str, data: bytes) -> None:
        """Write a file whole, though not onto the disk: a power cut may cost it."""
        path = self.path / name
        draft = path.with_name(f".{path.name}.{token_hex(8)}{_DRAFT}")
        try:
            try:
                draft.write_bytes(data)
            except FileNotFoundError:
                path.parent.mkdir(parents=True, exist_ok=True)
                draft.write_bytes(data)
            draft.replace(path)
        except BaseException:
            draft.unlink(missing_ok=True)
            raise

    def publish(self, key: str, files: Mapping[str, Content], result: Mapping[str, Any]) -> int:
        """Write files and manifest into a draft of the folder, onto the disk, and rename it."""
        folder = self.path / folder_of(key)
        if not files:
            # A damaged manifest is no result: it need not be on the disk before it has its name.
            manifest = json_text({**result, "files": {}})
            self.write(f"{folder_of(key)}/{MANIFEST}", manifest.encode())
            return len(manifest)
        draft = folder.with_name(f".{key}.{token_hex(8)}{_DRAFT}")
        draft.mkdir(parents=True)
        try:
            with TemporaryDirectory(dir=draft) as made_in:
                made, hashes = _made(files, Path(made_in))
                manifest = json_text({**result, "files": hashes})
                contents: dict[str, Content] = {name: path.replace for name, path in made.items()}
                write_folder(draft, {**contents, MANIFEST: manifest})
            try:
                draft.rename(folder)
            except OSError:
                if self.read(f"{folder_of(key)}/{MANIFEST}") is None:
                    shutil.rmtree(folder, ignore_errors=True)  # of no use
                    draft.rename(folder)
                # else another worker was first, with the same bytes
        finally:
            shutil.rmtree(draft, ignore_errors=True)
        return len(manifest) + sum(int(one["bytes"]) for one in hashes.values())

    def finished(self) -> set[str]:
        """Keys of all tasks whose results are whole."""
        return {path.parent.name for path in self.path.glob(f"results/*/*/{MANIFEST}")}


class Remote(Store):
    """A place that fsspec reaches, such as ``s3://bucket/campaign``."""

    def __init__(self, where: str) -> None:
        with from_extra("cluster"):
            from fsspec.core import url_to_fs
        try:
            self.system, self.root = url_to_fs(where)
        except (ImportError, ValueError) as error:
            raise InputError(f"{where}: expected a place that fsspec reaches: {error}") from None
        self.where = where
        protocol = self.system.protocol
        names = {protocol} if isinstance(protocol, str) else set(protocol)
        self._writes_whole = bool(names & _WHOLE)

    def _at(self, name: str) -> str:
        return f"{self.root.rstrip('/')}/{name}"

    def read(self, name: str) -> bytes | None:
        """Return a file's bytes, or None where there is none."""
        try:
            return bytes(self.system.cat_file(self._at(name)))
        except FileNotFoundError:
            return None

    def write(self, name: str, data: bytes) -> None:
        """Write a file whole."""
        path = self._at(name)
        if self._writes_whole:
            self.system.pipe_file(path, data)
            return
        self.system.makedirs(path.rpartition("/")[0], exist_ok=True)
        draft = f"{path}.{token_hex(8)}{_DRAFT}"
        self.system.pipe_file(draft, data)
        self.system.mv(draft, path)

    def publish(self, key: str, files: Mapping[str, Content], result: Mapping[str, Any]) -> int:
        """Write files before the manifest that names them."""
        folder = folder_of(key)
        with TemporaryDirectory(prefix="haptix-") as drafts:
            made, hashes = _made(files, Path(drafts))
            for name, path in made.items():
                self.write(f"{folder}/{name}", path.read_bytes())
        manifest = json_text({**result, "files": hashes}).encode()
        self.write(f"{folder}/{MANIFEST}", manifest)
        return len(manifest) + sum(int(one["bytes"]) for one in hashes.values())

    def finished(self) -> set[str]:
        """Keys of all tasks whose results are whole."""
        try:
            found = self.system.find(self._at("results"))
        except FileNotFoundError:
            return set()
        paths = map(PurePosixPath, found)
        return {path.parent.name for path in paths if path.name == MANIFEST}


def store_at(where: str | Path) -> Store:
    """Return the store at a path, or at a URL of fsspec such as ``s3://bucket/campaign``."""
    return Remote(str(where)) if "://" in str(where) else Folder(where)


def _made(files: Mapping[str, Content], folder: Path) -> tuple[dict[str, Path], dict[str, Any]]:
    """Make a task's files in a folder; return their paths, and their hashes and sizes."""
    made, hashes = {}, {}
    for name, content in files.items():
        path = made[name] = folder / name
        if callable(content):
            content(path)
        else:
            path.write_bytes(content.encode() if isinstance(content, str) else content)
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        hashes[name] = {"sha256": digest, "bytes": path.stat().st_size}
    return made, hashes
