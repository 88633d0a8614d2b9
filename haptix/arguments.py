"""Checks of what is typed on a command line, before torch loads: callbacks for Typer's options.

Each returns the value as it came, or raises an `InputError` that names the option.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from math import inf, isfinite
from pathlib import Path
from typing import Any, get_args

import typer

from firmware_io.address import SchemeName, split_address
from haptix.errors import InputError

Check = Callable[[typer.CallbackParam, Any], Any]


def number(*, above: float = -inf, least: float = -inf, most: float = inf) -> Check:
    """Refuse what is not finite or out of range."""
    expected = "a finite number" + _bounds(above, least, most)

    def check(option: typer.CallbackParam, value: Any) -> Any:
        for one in value if isinstance(value, list | tuple) else [value]:
            if one is not None and not (isfinite(one) and one > above and least <= one <= most):
                raise InputError(f"{_name(option)}: expected {expected}, got {one:g}")
        return value

    return check


def numbers(*, above: float = -inf, least: float = -inf, is_range: bool = False) -> Check:
    """Refuse a text that is not finite numbers separated by commas, or LOW,HIGH."""
    bounds = _bounds(above, least, inf)

    def check(option: typer.CallbackParam, value: Any) -> Any:
        if value is None:
            return value
        found = (read_pair if is_range else read_numbers)(_name(option), value)
        for one in found:
            if not (isfinite(one) and one > above and one >= least):
                raise InputError(f"{_name(option)}: expected finite numbers{bounds}, got {one:g}")
        if is_range and found[0] > found[-1]:
            raise InputError(f"{_name(option)}: expected LOW <= HIGH, got {tuple(found)}")
        return value

    return check


def one_of(*words: str) -> Check:
    """Refuse any other word."""

    def check(option: typer.CallbackParam, value: Any) -> Any:
        if value is not None and value not in words:
            known = ", ".join(words)
            raise InputError(f"{_name(option)}: expected one of {known}, got {value!r:.80}")
        return value

    return check


def preset_or_file(kind: str, presets: Collection[str]) -> Check:
    """Refuse what is neither a preset's name nor a TOML file that is there."""

    def check(option: typer.CallbackParam, value: Any) -> Any:
        if isinstance(value, str) and value.endswith(".toml"):
            is_there(option, Path(value))
        elif value is not None and value not in presets:
            raise InputError(
                f"unknown {kind} preset {value!r:.80}: expected one of {', '.join(presets)}, or a "
                "file whose name ends in .toml"
            )
        return value

    return check


def device_address(option: typer.CallbackParam, value: Any) -> Any:
    """Refuse an address of no known scheme."""
    if value is not None:
        split_address(value, get_args(SchemeName))
    return value


def is_there(option: typer.CallbackParam, value: Any) -> Any:
    """Refuse the path of a file, or several, that cannot be read."""
    for path in value if isinstance(value, list | tuple) else [value]:
        try:
            missing = path is not None and not path.exists()
        except (OSError, ValueError) as error:  # a name with a NUL, or far too long
            why = getattr(error, "strerror", None) or error
            raise InputError(f"{_name(option)}: no file has such a name: {why}") from None
        if missing:
            raise InputError(f"{_name(option)}: cannot read {path}: there is no such file")
        if path is not None and path.is_dir():
            raise InputError(f"{_name(option)}: expected a file, but {path} is a folder")
    return value


def material_file(option: typer.CallbackParam, value: Any) -> Any:
    """Refuse a file that cannot be read; ``gallery:NAME`` is none."""
    return value if str(value).startswith("gallery:") else is_there(option, value)


def refuse_input(out: Path, *inputs: Path) -> None:
    """Refuse to write a file onto one that is read."""
    for one in inputs:
        if out.exists() and one.exists() and out.samefile(one):
            raise InputError(f"{out} is the file that is read: name another one to write")


def folder(option: typer.CallbackParam, value: Any) -> Any:
    """Refuse a folder that cannot be made, because a file has its name."""
    if value is not None and (above := _first_that_exists(value)) and not above.is_dir():
        raise InputError(f"{_name(option)}: {above} is a file; name a folder")
    return value


def _first_that_exists(path: Path) -> Path | None:
    return next((one for one in (path, *path.absolute().parents) if one.exists()), None)


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
