"""Checks of what is typed on a command line, before torch loads: callbacks for Typer's options.

Each returns the value as it came, or raises an `InputError` that names the option.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from difflib import get_close_matches
from math import inf, isfinite
from pathlib import Path
from typing import Any

import typer

from haptix.errors import DeviceError, InputError

Check = Callable[[typer.CallbackParam, Any], Any]


def number(*, above: float = -inf, least: float = -inf, most: float = inf) -> Check:
    """Refuse what is not finite or out of range."""
    expected = "a finite number" + _bounds(above, least, most)

    def check(option: typer.CallbackParam, value: Any) -> Any:
        for one in value if isinstance(value, list | tuple) else [value]:
            if one is not None and not (-inf < one < inf and above < one and least <= one <= most):
                shown = f"{one:g}" if isinstance(one, float) else f"{one!s:.20}"
                raise InputError(f"{_name(option)}: expected {expected}, got {shown}")
        return value

    return check


def numbers(
    *, above: float = -inf, least: float = -inf, is_range: bool = False, is_whole: bool = False
) -> Check:
    """Refuse a text that is not finite numbers separated by commas, or LOW,HIGH."""
    expected = f"finite{' whole' * is_whole} numbers{_bounds(above, least, inf)}"

    def check(option: typer.CallbackParam, value: Any) -> Any:
        if value is None:
            return value
        found = (read_pair if is_range else read_numbers)(_name(option), value)
        for one in found:
            wrong = not (isfinite(one) and one > above and one >= least)
            if wrong or (is_whole and one != int(one)):
                raise InputError(f"{_name(option)}: expected {expected}, got {one:g}")
        if is_range and found[0] > found[-1]:
            raise InputError(f"{_name(option)}: expected LOW <= HIGH, got {tuple(found)}")
        return value

    return check


def one_of(*words: str) -> Check:
    """Refuse any other word."""

    def check(option: typer.CallbackParam, value: Any) -> Any:
        if value is not None and value not in words:
            raise InputError(
                f"{_name(option)}: expected one of {', '.join(words)}, got {value!r:.80}"
                f"{_nearest(words, value)}"
            )
        return value

    return check


def some_of(*words: str) -> Check:
    """Refuse a list in which any other word stands."""
    check_one = one_of(*words)

    def check(option: typer.CallbackParam, value: Any) -> Any:
        for one in value or ():
            check_one(option, one)
        return value

    return check


def preset_or_file(kind: str, presets: Collection[str]) -> Check:
    """Refuse what is neither a preset's name nor a TOML file that is there."""

    def check(option: typer.CallbackParam, value: Any) -> Any:
        if isinstance(value, str) and value.endswith(".toml"):
            is_there(option, Path(value))
        elif value is not None and value not in presets:
            raise InputError(
                f"{_name(option)}: unknown {kind} preset {value!r:.80}: expected one of "
                f"{', '.join(presets)}, or a file whose name ends in .toml"
                f"{_nearest(presets, value)}"
            )
        return value

    return check


def device_address(option: typer.CallbackParam, value: Any) -> Any:
    """Refuse an address of no known scheme, or whose keys or values its scheme does not have."""
    if value is not None:
        try:
            from firmware_io.opening import read_address  # with numpy

            read_address(value)
        except DeviceError as error:
            raise InputError(f"{_name(option)}: {error}") from None
    return value


def is_there(option: typer.CallbackParam, value: Any) -> Any:
    """Refuse the path of a file, or several, that cannot be read."""
    for path in value if isinstance(value, list | tuple) else [value]:
        if path is not None and not _exists(option, path):
            raise InputError(f"{_name(option)}: cannot read {path}: there is no such file")
        if path is not None and path.is_dir():
            raise InputError(f"{_name(option)}: expected a file, but {path} is a folder")
    return value


def material_file(option: typer.CallbackParam, value: Any) -> Any:
    """Refuse a file that cannot be read; ``gallery:NAME`` is none."""
    return value if str(value).startswith("gallery:") else is_there(option, value)


def file_to_write(option: typer.CallbackParam, value: Any) -> Any:
    """Refuse the path of a file that cannot be made: a folder, or below another file."""
    if value is not None:
        if _exists(option, value) and value.is_dir():
            raise InputError(f"{_name(option)}: expected a file, but {value} is a folder")
        if not (above := _above(option, value.parent)).is_dir():
            raise InputError(f"{_name(option)}: cannot make {value}: {above} is a file")
    return value


def refuse_input(out: Path, *inputs: Path) -> None:
    """Refuse to write a file onto one that is read."""
    for one in inputs:
        if out.exists() and one.exists() and out.samefile(one):
            raise InputError(f"{out} is the file that is read: name another one to write")


def folder(option: typer.CallbackParam, value: Any) -> Any:
    """Refuse a folder that cannot be made, because a file has its name."""
    if value is not None and not (above := _above(option, value)).is_dir():
        raise InputError(f"{_name(option)}: {above} is a file; name a folder")
    return value


def file_or_folder(option: typer.CallbackParam, value: Any) -> Any:
    """Refuse what does not exist."""
    if not _exists(option, value):
        raise InputError(f"{_name(option)}: cannot read {value}: there is no such file or folder")
    return value


def folder_there(option: typer.CallbackParam, value: Any) -> Any:
    """Refuse what is no folder that exists."""
    file_or_folder(option, value)
    return folder(option, value)


def text(option: typer.CallbackParam, value: Any) -> Any:
    """Refuse an empty or blank text."""
    if value is not None and not value.strip():
        raise InputError(f"{_name(option)}: expected a text, got {value!r:.80}")
    return value


def label(option: typer.CallbackParam, value: Any) -> Any:
    """Refuse what is no label of the Brain Imaging Data Structure."""
    if value is not None and not re.fullmatch(r"[A-Za-z0-9]{1,64}", value):
        raise InputError(
            f"{_name(option)}: BIDS labels have letters and digits alone, got {value!r:.80}"
        )
    return value


def _above(option: typer.CallbackParam, path: Path) -> Path:
    """Return the path, or the first folder above it that exists."""
    return next(one for one in (path, *path.absolute().parents) if _exists(option, one))


def _exists(option: typer.CallbackParam, path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError) as error:  # a name with a NUL, or far too long
        why = getattr(error, "strerror", None) or error
        raise InputError(f"{_name(option)}: no file has such a name: {why}") from None


def _nearest(words: Collection[str], value: str) -> str:
    near = get_close_matches(value.lower(), words, 1)
    return f"; did you mean {near[0]}?" if near else ""


def read_numbers(option: str, text: str) -> list[float]:
    """Read numbers separated by commas."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(
            f"{option}: expected numbers separated by commas, such as 0.2,0.5, got {text!r:.80}"
        ) from None


def read_pair(option: str, text: str) -> tuple[float, float]:
    """Read LOW,HIGH; one value stands for both."""
    found = read_numbers(option, text)
    if len(found) > 2:
        raise InputError(f"{option}: expected LOW,HIGH or one value, got {text!r:.80}")
    return found[0], found[-1]


def _bounds(above: float, least: float, most: float) -> str:
    bounds = [f"above {above:g}"] * (above > -inf) + [f"of at least {least:g}"] * (least > -inf)
    bounds += [f"of at most {most:g}"] * (most < inf)
    return " " + " and ".join(bounds) if bounds else ""


def _name(option: typer.CallbackParam) -> str:
    # Arguments have no dashes: they are named as in the usage line.
    return next((one for one in option.opts if one.startswith("--")), str(option.name).upper())
