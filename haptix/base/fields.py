"""Types of parameters that tasks share: files, folders, devices, labels, texts, numbers.

Each checks its value before torch loads. The message leaves the parameter's name to the caller.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Collection
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field

from haptix.base.errors import DeviceError, InputError
from haptix.base.files import checked_values

LIFTED_BELOW_N = 1e-3
"""Normal force [N] below which a finger does not touch."""
HARDEST_N = 100.0
"""Largest normal force [N] of a finger; a larger number probably has another unit."""
LEAST_AREA_M2, LARGEST_AREA_M2 = 1e-8, 1e-2
"""Areas of contact: of a spot of a tenth of a millimetre, and of a whole hand."""
LARGEST_MM = 1e4
"""Ten metres: a place that is farther away is not in millimetres."""

Force = Annotated[float, Field(gt=0, le=HARDEST_N, allow_inf_nan=False)]
"""A field that is the normal force of a finger [N]."""
TouchForce = Annotated[float, Field(ge=LIFTED_BELOW_N, le=HARDEST_N)]
ContactArea = Annotated[float, Field(ge=LEAST_AREA_M2, le=LARGEST_AREA_M2)]
"""Fields of a finger that touches [N, m^2]."""


@dataclass(frozen=True)
class Typed:
    """How the command line takes a parameter, where its name alone does not show it."""

    option: str = ""
    """Its option, if that is not made from its name."""
    is_argument: bool = False
    """Whether it is a positional argument instead of an option."""
    metavar: str | None = None
    """Word for its value in the help."""


class Local:
    """Marks a name of a file or device of this machine: no client of the network may send it."""


class ForClients:
    """Marks a document or a list that clients of the service must send; it is no option."""


JsonObject = Annotated[dict[str, Any], AfterValidator(checked_values)]
"""A document from an untrusted source, no larger than a file may be: see `checked_values`."""


@dataclass(frozen=True)
class ProfileName:
    """Marks the name of a finger or a screen: the service knows which ones a client may use."""

    presets: tuple[str, ...]
    """Those that come with haptix."""


def expected_words(words: Collection[str], value: str) -> str:
    """Name the words that were expected, and the nearest one."""
    near = get_close_matches(value.lower(), words, 1)
    meant = f"; did you mean {near[0]}?" if near else ""
    return f"expected one of {', '.join(words)}, got {value!r:.80}{meant}"


def one_of(*words: str) -> Callable[[str], str]:
    """Return a check that refuses any other word."""

    def check(value: str) -> str:
        if value not in words:
            raise ValueError(expected_words(words, value))
        return value

    return check


def is_there(path: Path) -> Path:
    """Refuse the path of a file that cannot be read."""
    if not _exists(path):
        raise ValueError(f"cannot read {path}: there is no such file")
    if path.is_dir():
        raise ValueError(f"expected a file, but {path} is a folder")
    return path


def file_to_write(path: Path) -> Path:
    """Refuse the path of a file that cannot be made: a folder, or below another file."""
    if _exists(path) and not path.is_file():
        what = "a folder" if path.is_dir() else "a pipe, a socket or a device"
        raise ValueError(f"expected a file, but {path} is {what}")
    if not (above := _above(path.parent)).is_dir():
        raise ValueError(f"cannot make {path}: {above} is a file")
    _may_write(above)
    return path


def ending(*suffixes: str) -> Callable[[Path], Path]:
    """Return a check that refuses another ending of a name: the file may be something else."""

    def check(path: Path) -> Path:
        if path.suffix.lower() not in suffixes:
            raise ValueError(f"expected a name that ends in {' or '.join(suffixes)}, got {path}")
        return path

    return check


def folder(path: Path) -> Path:
    """Refuse a folder that cannot be made, because a file has its name."""
    if not (above := _above(path)).is_dir():
        raise ValueError(f"{above} is a file; name a folder")
    if above != path:  # one that is there may be read alone
        _may_write(above)
    return path


def file_or_folder(path: Path) -> Path:
    """Refuse a path that does not exist."""
    if not _exists(path):
        raise ValueError(f"cannot read {path}: there is no such file or folder")
    return path


def _above(path: Path) -> Path:
    """Return the path, or the first folder above it that exists."""
    return next(each for each in (path, *path.absolute().parents) if _exists(each))


def _may_write(folder: Path) -> None:
    if not os.access(folder, os.W_OK):
        raise ValueError(f"cannot write into {folder}: permission denied")


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError) as error:  # a name with a NUL, or far too long
        why = getattr(error, "strerror", None) or error
        raise ValueError(f"no file has such a name: {why}") from None


def check_new(path: Path, overwrite: bool, *inputs: Path) -> None:
    """Refuse to write onto an input, and onto a file that exists unless it may be replaced."""
    if path.exists() and not overwrite:
        raise InputError(f"{path} exists: name another file, or pass --overwrite to replace it")
    file_to_write(path)
    refuse_input(path, *inputs)


def refuse_input(out: Path, *inputs: Path) -> None:
    """Refuse to write onto an input."""
    for file in inputs:
        if out.exists() and file.exists() and out.samefile(file):
            raise InputError(f"{out} is the file that is read: name another file to write")


def _material(value: Path) -> Path:
    return value if str(value).startswith("gallery:") else is_there(value)


def _address(value: str) -> str:
    from firmware_io.opening import read_address  # with numpy

    try:
        read_address(value)
    except DeviceError as error:
        raise ValueError(str(error)) from None
    return value


def _text(value: str) -> str:
    if not value.strip():
        raise ValueError(f"expected a text, got {value!r:.80}")
    return value


def _is_ordered(value: tuple[float, float]) -> tuple[float, float]:
    if value[0] > value[1]:
        raise ValueError(f"expected LOW <= HIGH, got {value}")
    return value


def _label(value: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9]{1,64}", value):
        raise ValueError(f"BIDS labels have letters and digits alone, got {value!r:.80}")
    return value


FileThere = Annotated[Path, AfterValidator(is_there), Local()]
NewFile = Annotated[Path, AfterValidator(file_to_write), Local()]
NewPicture = Annotated[NewFile, AfterValidator(ending(".png"))]
NewDocument = Annotated[NewFile, AfterValidator(ending(".toml", ".json"))]
Folder = Annotated[Path, AfterValidator(folder), Local()]
FolderThere = Annotated[Path, AfterValidator(file_or_folder), AfterValidator(folder), Local()]
FileOrFolder = Annotated[Path, AfterValidator(file_or_folder), Local()]
MaterialFile = Annotated[Path, AfterValidator(_material), Local()]
Address = Annotated[str, AfterValidator(_address), Local()]
FOLDER_NAME = r"^[A-Za-z0-9][A-Za-z0-9_\-]{0,79}$"
"""Pattern of the names under which the service keeps files of clients; browsers accept it, too."""
FolderName = Annotated[str, Field(pattern=FOLDER_NAME)]
Label = Annotated[str, AfterValidator(_label)]
Text = Annotated[str, AfterValidator(_text), Field(json_schema_extra={"pattern": r"\S"})]
Positive = Annotated[float, Field(gt=0)]
Frequency = Annotated[float, Field(gt=0, le=1e8)]  # [Hz]; above, the circuit is no capacitor
NotNegative = Annotated[float, Field(ge=0)]
Seed = Annotated[int, Field(ge=0, le=2**63 - 1)]
Range = Annotated[tuple[float, float], AfterValidator(_is_ordered)]
PositiveRange = Annotated[tuple[Positive, Positive], AfterValidator(_is_ordered)]
ForceRange = Annotated[tuple[Force, Force], AfterValidator(_is_ordered)]
FrequencyRange = Annotated[tuple[Frequency, Frequency], AfterValidator(_is_ordered)]
Argument = Typed(is_argument=True)
