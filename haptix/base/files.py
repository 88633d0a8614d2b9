"""Files: written whole or not at all; one that cannot be read gives a sentence with the reason."""

from __future__ import annotations

import csv
import ctypes
import errno
import io
import json
import logging
import os
import re
import shutil
import stat
import sys
import time
import tomllib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from itertools import islice
from math import isfinite
from pathlib import Path
from secrets import token_hex
from typing import Any, TypeVar

import platformdirs

from haptix.base.errors import FileFormatError, HaptixError, InputError

LARGEST_DOCUMENT_BYTES = 4_000_000
"""Largest JSON, TOML or XML file. Those of haptix have some kilobytes; a TOML file of this size
takes up to ten seconds to parse."""
LARGEST_TABLE_BYTES = LARGEST_PICTURE_BYTES = 64_000_000
"""Largest CSV file: half an hour of a finger at 1 kHz; its rows take some ten times as much memory.
Also the largest picture that is read as a whole: the pixels of the largest texture in 16 bits."""

FULL_DISK = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))  # no quota on Windows
_MANY_FILES = 64  # from here on they are synced together: one fsync takes milliseconds
_BLOCK_BYTES = 1 << 20
_LOG = logging.getLogger("haptix.base.files")
_LONGEST_WRITE_S = 60.0
_MOST_VALUES = 100_000  # of a document; checks of that many wrong ones take 0.6 GB and 6 s
_DEEPEST = 64  # tables and lists in each other; those of haptix have at most ten
_UNUSABLE = re.compile("[\0\ud800-\udfff]")
# Dotted keys: the time of tomllib grows with the square of their number of parts.
_DOTTED = re.compile(
    r"""(?<![\w-])(?:(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+)++"""
)

_ENCODER = json.JSONEncoder(ensure_ascii=False, allow_nan=False)
Number = TypeVar("Number", int, float)
Content = bytes | memoryview | str | Callable[[Path], object]
"""Content of a file: bytes, text, or a function that takes a path and writes the file there."""


def file_at(name: str, path: Any) -> Path:
    """Return a path; raise `InputError` if the value is none."""
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"{name}: expected the path of a file, got {path!r:.80}")
    return Path(path)


def file_name(name: str, text: str) -> str:
    """Return a text that names a file or folder on every system, or raise `InputError`."""
    if not re.fullmatch(r"[\w-](?:[\w .,()+-]{0,98}[\w)+-])?", text):
        raise InputError(
            f"{name}: names a file or a folder: expected letters, digits, '-' and '_', with spaces "
            f"and points between them, got {text!r:.80}"
        )
    return text


def write_whole(path: str | Path, content: Content, is_secret: bool = False) -> None:
    """Write a file, or leave the old one and raise `FileFormatError`.

    Missing folders are made. The content is written to a temporary file beside the file and synced
    to the disk; only then does it get its name. Links are followed, and a file keeps its mode and
    owner. A file is refused if it is not regular, may not be written or would change its owner.

    Parameters
    ----------
    path : path-like
        The file, or a link to it.
    content : bytes, str or callable
        Its content.
    is_secret : bool
        Whether only this user may ever read it; a link or file of that name is then replaced.
    """
    path = file_at("path", path)
    try:
        _write({path: content}, is_secret)
    except OSError as error:
        raise FileFormatError(f"cannot write {path}: {write_failure(error, path)}") from error


def write_folder(folder: Path, files: Mapping[str, Content]) -> list[Path]:
    """Write a set of files into a folder and return their paths, or raise `InputError`.

    The folder is made if needed. All files are on the disk before the first gets its name. The last
    one is the manifest: where it exists, all others are of the same set. Other files in the folder
    stay as they are.
    """
    targets = {folder / name: content for name, content in files.items()}
    try:
        _write(targets)
    except OSError as error:
        raise InputError(f"cannot write to {folder}: {write_failure(error, folder)}") from error
    return list(targets)


def is_full_disk(error: BaseException | None) -> bool:
    """Whether an error, or its cause, is that a disk or a quota is full."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in FULL_DISK:
            return True
        error = error.__cause__
    return False


def write_failure(error: OSError, path: Path) -> str:
    """Return why `path` could not be written; for a full disk, which one and its free space."""
    why = error.strerror or str(error)
    if error.errno not in FULL_DISK:
        return why
    whole = path.absolute()
    existing = next(above for above in (whole, *whole.parents) if above.exists())
    disk = next(above for above in (existing, *existing.parents) if os.path.ismount(above))
    free_mb = shutil.disk_usage(disk).free / 1e6
    return (
        f"{why}: the disk at {disk} has {free_mb:.3g} MB free; make room there, or name a place on "
        "another"
    )


def _write(files: Mapping[Path, Content], is_secret: bool = False) -> None:
    drafts: dict[Path, Path] = {}
    try:
        for path, content in files.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            real, there = (path, None) if is_secret else place(path)
            draft = real.with_name(f".{real.name}.{token_hex(8)}.part")
            drafts[draft] = path
            mode = 0o600 if is_secret or there else 0o666
            os.close(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode))
            if callable(content):
                content(draft)
            else:
                draft.write_bytes(content.encode() if isinstance(content, str) else content)
        publish(drafts, is_secret)
    finally:
        for draft in drafts:
            with suppress(OSError):
                draft.unlink(missing_ok=True)


def place(path: Path) -> tuple[Path, os.stat_result | None]:
    """Return the file that a path leads to, and its `os.stat` if it exists.

    Raises `OSError` if it is not a regular file, or this user may not write it.
    """
    real = Path(os.path.realpath(path))
    if not os.path.lexists(real):
        if path.is_symlink():  # the system does not follow a stranger's link in a shared folder
            os.close(os.open(path, os.O_WRONLY | os.O_CREAT, 0o600))
            real.unlink()
        return real, None
    file_stat = real.stat()
    if stat.S_ISDIR(file_stat.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(file_stat.st_mode):
        raise OSError(errno.EINVAL, "this is a pipe, a socket or a device; name a regular file")
    os.close(os.open(path, os.O_WRONLY))
    return real, file_stat


def _keep_mode(draft: Path, there: os.stat_result) -> None:
    """Give a draft the owner and mode of the file that it replaces."""
    draft_stat = draft.stat()
    if (draft_stat.st_uid, draft_stat.st_gid) != (there.st_uid, there.st_gid):
        try:
            os.chown(draft, there.st_uid, there.st_gid)
        except PermissionError:
            why = "it belongs to another user or group; remove it first, or name another file"
            raise PermissionError(errno.EPERM, why) from None
    draft.chmod(stat.S_IMODE(there.st_mode))


def publish(drafts: Mapping[Path, Path], is_secret: bool = False) -> None:
    """Give finished drafts their final names; the last one is the manifest of the others.

    Links are followed, and files keep their mode and owner; see `write_whole`.
    """
    places = {draft: (path, None) if is_secret else place(path) for draft, path in drafts.items()}
    for draft, (_, there) in places.items():
        if there is not None:
            _keep_mode(draft, there)
    drafts = {draft: real for draft, (real, _) in places.items()}
    _sync_files(drafts)
    *others, (draft, manifest) = drafts.items()
    if others:
        # While the files change, an old manifest would list files of the new set.
        manifest.unlink(missing_ok=True)
        for other, target in others:
            other.replace(target)
        _sync_folders(target for _, target in others)
    draft.replace(manifest)
    _sync_folders([manifest])


def _sync_files(files: Collection[Path]) -> None:
    """Sync files to the disk; if they are many, by one call for each file system."""
    with suppress(AttributeError, OSError):  # where the C library has no such call
        if len(files) > _MANY_FILES and sys.platform == "linux":
            for folder in {file.parent for file in files}:
                opened = os.open(folder, os.O_RDONLY)
                try:
                    if ctypes.CDLL(None, use_errno=True).syncfs(opened) != 0:
                        raise OSError(ctypes.get_errno(), "syncfs")
                finally:
                    os.close(opened)
            return
    for file in files:
        _sync(file)


def _sync(path: Path) -> None:
    opened = os.open(path, os.O_RDONLY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)


def _sync_folders(files: Iterable[Path]) -> None:
    for folder in {file.parent for file in files}:
        with suppress(OSError):  # some file systems sync files only
            _sync(folder)


def remove_drafts(folder: Path) -> None:
    """Remove what `write_whole` had begun in a folder and below when its process was killed.

    Parameters
    ----------
    folder : Path
        The folder. Drafts of the last minute stay: another process may be writing them.
    """
    for draft in folder.rglob(".*.part"):
        with suppress(OSError):
            if draft.stat().st_mtime < time.time() - _LONGEST_WRITE_S:
                draft.unlink()


def set_aside(path: Path, why: Exception) -> None:
    """Rename a damaged file of the program's own, so that it begins anew and a person can look.

    Parameters
    ----------
    path : Path
        The file, which is called NAME.damaged afterwards; an earlier one of that name goes.
    why : Exception
        Its fault; both are logged as a warning.
    """
    aside = path.with_name(f"{path.name}.damaged")
    path.replace(aside)
    _LOG.warning("%s is damaged (%s): it is kept as %s, and begun anew", path, why, aside.name)


def check_folder(folder: Path, names: Iterable[str]) -> None:
    """Raise `InputError`, before the work, if `names` cannot be written into a folder."""
    existing = next(above for above in (folder, *folder.parents) if above.exists())
    if not existing.is_dir():
        raise InputError(f"--out: {existing} is a file; name a folder")
    for path in (folder / name for name in names):
        if path.exists() and not path.is_file():
            what = "a folder" if path.is_dir() else "no regular file"
            raise InputError(f"--out: {path} is {what}; name another --out")


def json_text(value: object) -> str:
    """Return plain values as JSON text, without NaN and with a line break at the end."""
    return json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def digest(plain: Any) -> str:
    """SHA-256 of plain values, such as the description of a model or of a file."""
    return sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()


def json_table(table: Mapping[str, object]) -> str:
    """Return a table as JSON text with a line for each key: ten times as fast as `json_text`."""
    lines = (f"  {json.dumps(key)}: {_ENCODER.encode(value)}" for key, value in table.items())
    return "{\n" + ",\n".join(lines) + "\n}\n"


def read_bytes(path: str | Path, largest_bytes: int = LARGEST_DOCUMENT_BYTES) -> bytes:
    """Read a file of at most `largest_bytes`, or raise `FileFormatError`."""
    path = file_at("path", path)
    try:
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            if size <= largest_bytes:
                # A pipe or a device has no size.
                blocks = iter(partial(file.read, _BLOCK_BYTES), b"")
                data = b"".join(islice(blocks, largest_bytes // _BLOCK_BYTES + 2))
                size = max(size, len(data))
    except (OSError, ValueError) as error:  # a name with a NUL is a ValueError
        why = getattr(error, "strerror", None) or error
        raise FileFormatError(f"cannot read {path}: {why}") from None
    if size > largest_bytes:
        raise FileFormatError(
            f"{path}: expected a file of at most {largest_bytes / 1e6:g} MB, got "
            f"{size / 1e6:.3g} MB; is it another file? If not, split it or thin it out"
        )
    return data


def read_text(path: str | Path, largest_bytes: int = LARGEST_DOCUMENT_BYTES) -> str:
    """Read a text file in UTF-8, with or without a byte-order mark, or raise `FileFormatError`.

    Line breaks stay as they are, since the cells of a table may hold some.
    """
    try:
        return read_bytes(path, largest_bytes).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise FileFormatError(
            f"{path}: expected a text file in UTF-8, got another encoding; save it as UTF-8"
        ) from None


@contextmanager
def reading(path: str | Path, expected: str) -> Iterator[None]:
    """Raise `FileFormatError` for every error that the contents of a file cause.

    Parameters
    ----------
    path : path-like
        The file.
    expected : str
        Its expected kind, such as "a checkpoint of an ensemble".
    """
    try:
        yield
    except HaptixError:
        raise
    except OSError as error:
        raise FileFormatError(f"cannot read {path}: {error.strerror or error}") from None
    except Exception as error:  # every library has errors of its own
        why = str(error) or type(error).__name__
        message = f"{path}: expected {expected}, wrong or missing: {why:.300}"
        raise FileFormatError(message) from None


def parse_json(text: str | bytes, most_values: int = _MOST_VALUES) -> Any:
    """Parse JSON that may come from anywhere.

    Raises `ValueError` if it is not JSON, an object has a name twice, of which readers take the
    one or the other (RFC 8259, 4), or it holds more than a document may: see `checked_values`.

    Examples
    --------
    >>> parse_json('{"width_mm": 60}')
    {'width_mm': 60}
    """
    try:
        value = json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=_each_once)
        return checked_values(value, most_values)
    except RecursionError:
        raise _too_deep() from None


def checked_values(value: Any, most_values: int = _MOST_VALUES, *, is_json: bool = True) -> Any:
    """Return the values of a parsed document.

    Raises `ValueError` if they are too many or nested too deep, an integer has more than 64 bits,
    a number of JSON is not finite (TOML has a word for such numbers), or a text holds a character
    that no file name or terminal takes.
    """
    level, count = [value], 0
    for _ in range(_DEEPEST):
        inner: list[Any] = []
        for item in level:
            if isinstance(item, dict):
                inner += item
                inner += item.values()
            elif isinstance(item, list):
                inner += item
            elif isinstance(item, str):
                if _UNUSABLE.search(item):
                    raise ValueError(f"a text with a NUL or half a character: {item!r:.60}")
            elif isinstance(item, int) and item.bit_length() > 64:
                raise ValueError(f"an integer of {item.bit_length()} bits; expected 64 at most")
            elif is_json and isinstance(item, float) and not isfinite(item):
                raise ValueError(f"{item}, or a number as large; expected 1.8e308 at most")
        count += len(inner)
        if count > most_values:
            raise ValueError(f"more than {most_values} values; keep measurements in CSV files")
        if not inner:
            return value
        level = inner
    raise _too_deep()


def _too_deep() -> ValueError:
    return ValueError(f"tables or lists more than {_DEEPEST} deep in each other; flatten them")


def read_json(
    path: str | Path, largest_bytes: int = LARGEST_DOCUMENT_BYTES, most_values: int = _MOST_VALUES
) -> dict[str, Any]:
    """Read a JSON file that holds one object, or raise `FileFormatError`."""
    text = read_text(path, largest_bytes)
    try:
        value = parse_json(text, most_values)
    except ValueError as error:
        raise FileFormatError(f"{path}: expected a JSON file, got: {error}") from None
    if not isinstance(value, dict):
        raise FileFormatError(f"{path}: expected a JSON object, got {value!r:.40}")
    return value


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is no number of JSON")


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"the name {twice!r} stands twice in one object")
    return found


def read_toml(path: str | Path) -> dict[str, Any]:
    """Read a TOML file, or raise `FileFormatError`."""
    text = read_text(path)
    try:
        if any(key[0].count(".") > _DEEPEST for key in _DOTTED.finditer(text)):
            raise _too_deep()
        return dict(checked_values(tomllib.loads(text), is_json=False))
    except (ValueError, RecursionError) as error:
        why = _too_deep() if isinstance(error, RecursionError) else error
        raise FileFormatError(f"{path}: expected a TOML file, got: {why}") from None


def check_schema_version(path: str | Path, version: Any) -> None:
    """Raise `FileFormatError` unless a file's ``schema_version`` is the one that is read here."""
    if version != 1:
        raise FileFormatError(
            f"{path}: expected schema_version 1, got {version!r:.40}; update haptix to read it"
        )


@dataclass(frozen=True)
class CsvRow:
    """One row of a CSV file: its cells by column, and its place for error messages."""

    place: str
    cells: Mapping[str, str]

    def number(self, name: str) -> float:
        """Return the number in a cell, or raise `FileFormatError`."""
        return self._parsed(name, float, "a number")

    def whole(self, name: str) -> int:
        """Return the integer in a cell, or raise `FileFormatError`."""
        return self._parsed(name, int, "an integer")

    def _parsed(self, name: str, parse: Callable[[str], Number], expected: str) -> Number:
        cell = self.cells[name]
        try:
            return parse(cell)
        except ValueError:
            message = f"{self.place}: {name}: expected {expected}, got {cell!r:.60}"
            raise FileFormatError(message) from None


def read_csv(
    path: str | Path, required: Sequence[str] = (), optional: Sequence[str] = ()
) -> Iterator[CsvRow]:
    """Yield the rows of a CSV file with a line of column names; empty rows are skipped.

    Raises `FileFormatError` if the file cannot be read, a column is missing or named twice, or a
    row is too short or too long.

    Parameters
    ----------
    path : path-like
        In UTF-8, with or without a byte-order mark.
    required, optional : sequence of str
        Columns that must or may be there, in any order. Others may be there too.
    """
    text = read_text(path, LARGEST_TABLE_BYTES)
    reader = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True)
    try:
        names = [name.strip() for name in next(reader, [])]
        wrong = [name for name in required if names.count(name) != 1]
        wrong += [name for name in optional if names.count(name) > 1]
        if wrong or not names:
            raise FileFormatError(
                f"{path}: expected a first line naming {', '.join(required) or 'the columns'}, "
                f"each once; missing or repeated: {', '.join(wrong)}; found: {', '.join(names)}"
            )
        for row in reader:
            place = f"{path}, line {reader.line_num}"
            if not any(cell.strip() for cell in row):
                continue
            if len(row) != len(names):
                why = "decimals need a point, not a comma"
                if len(row) < len(names):
                    why = f"{names[len(row)]} is missing"
                raise FileFormatError(
                    f"{place}: expected {len(names)} values, got {len(row)}; {why}"
                )
            yield CsvRow(place, dict(zip(names, row, strict=True)))
    except csv.Error as error:
        raise FileFormatError(f"{path}: expected a CSV file, got: {error}") from None


def csv_text(
    names: Iterable[str], rows: Iterable[Iterable[object]], digits: int | None = None
) -> str:
    """Return a CSV table: a line of names, then the rows; None is an empty cell.

    Floats have `digits` significant digits; without it, as many as they need.

    Examples
    --------
    >>> print(csv_text(["x_mm", "mu"], [[0.0, 0.25], [1.0, 0.5]]), end="")
    x_mm,mu
    0.0,0.25
    1.0,0.5
    """
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(names)
    for row in rows:
        table.writerow(
            f"{cell:.{digits}g}" if digits and isinstance(cell, float) else cell for cell in row
        )
    return text.getvalue()


def cache_folder() -> Path:
    """Return ``$HAPTIX_CACHE``, or ``haptix`` in the user's cache folder."""
    if chosen := os.environ.get("HAPTIX_CACHE"):
        return Path(chosen).expanduser()
    return platformdirs.user_cache_path("haptix", appauthor=False)
