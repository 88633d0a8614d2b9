"""Numbers with units, as people write them in files: "150 V", "0.2 um", "500 V/um"."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from contextlib import suppress
from decimal import Decimal
from typing import Any

from haptix.base.errors import InputError

Dimension = Mapping[str, int]

_PREFIXES = {
    "p": -12, "n": -9, "u": -6, "\N{MICRO SIGN}": -6, "\N{GREEK SMALL LETTER MU}": -6,
    "m": -3, "c": -2, "": 0, "k": 3, "M": 6, "G": 9, "T": 12,
}  # fmt: skip
_SYMBOLS = {
    "V": "V", "N": "N", "Hz": "Hz", "m": "m", "Pa": "Pa", "s": "s", "g": "g", "°": "°",
    "S": "S", "F": "F", "deg": "°",
    "Ohm": "Ohm", "ohm": "Ohm", "\N{GREEK CAPITAL LETTER OMEGA}": "Ohm", "\N{OHM SIGN}": "Ohm",
}  # fmt: skip

_RAISED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")

# Suffix of a field's name: an example, and the power of ten of its own unit. Longest first, so
# that "_mm_per_s" is not taken for seconds.
_SUFFIXES: Mapping[str, tuple[str, str]] = {
    "_v_per_m": ("V/m", "500 V/um"),
    "_mm_per_s": ("mm/s", "100 mm/s"),
    "_mm_s": ("mm/s", "100 mm/s"),
    "_deg_s": ("°/s", "90 °/s"),
    "_ohm_m": ("Ohm m", "1 MOhm m"),
    "_per_m": ("/m", "4000 /m"),
    "_m2": ("m2", "45 mm2"),
    "_deg": ("°", "90 °"),
    "_kg": ("kg", "20 g"),
    "_ms": ("ms", "20 ms"),
    "_hz": ("Hz", "20 kHz"),
    "_pa": ("Pa", "40 MPa"),
    "_mm": ("mm", "40 mm"),
    "_m": ("m", "0.2 um"),
    "_n": ("N", "0.5 N"),
    "_v": ("V", "150 V"),
    "_s": ("s", "0.5 s"),
}

_NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*?)\s*")
_DECIMAL_COMMA = re.compile(r"^\s*([-+]?\d+),(\d+)(?![\d,])")
_FACTOR = re.compile(
    rf"([{''.join(_PREFIXES)}]?)({'|'.join(_SYMBOLS)})(?:\^?(-?\d)|(\N{{SUPERSCRIPT TWO}}))?"
)


FOREVER = "forever"
"""An endless length, in files; the fields that take it read it."""


def with_numbers(
    name: str, fields: Mapping[str, Any], texts: Collection[str] = ()
) -> dict[str, Any]:
    """Return a table in which strings such as "150 V" are numbers.

    Raises `InputError` if a string under such a key is not a number with such a unit.

    Parameters
    ----------
    name : str
        Name of the table in error messages.
    fields : mapping
        Values, lists and nested tables. The end of a key names its unit: ``h0_m = "0.2 um"``
        becomes 2e-7. Other strings stay as they are.
    texts : collection of str, optional
        Keys of texts, whose end names no unit: ``reaction_s = "key_resp.rt"`` names a column.

    Examples
    --------
    >>> with_numbers("screen", {"width_mm": "2 cm", "name": "left"})
    {'width_mm': 20.0, 'name': 'left'}
    """
    return {
        key: value if key in texts else _converted(f"{name}.{key}", key, value)
        for key, value in fields.items()
    }


def _converted(place: str, key: str, value: Any) -> Any:
    if isinstance(value, Mapping):
        # Here the keys are names of axes: h0_m = "keep".
        return dict(value) if key == "axes" else with_numbers(place, value)
    if isinstance(value, list):
        return [_converted(f"{place}.{i}", key, item) for i, item in enumerate(value)]
    if isinstance(value, str) and value != FOREVER:
        suffix = next((end for end in _SUFFIXES if key.endswith(end)), None)
        return value if suffix is None else _quantity(place, value, *_SUFFIXES[suffix])
    return value


def unit_of(name: str) -> str:
    """Return the unit at the end of a field's name, or an empty text.

    Examples
    --------
    >>> unit_of("normal_force_n")
    'N'
    """
    return next((unit for end, (unit, _) in _SUFFIXES.items() if name.endswith(end)), "")


def title_of(name: str) -> str:
    """Return a field's name in words, without its unit.

    Examples
    --------
    >>> title_of("normal_force_n")
    'Normal force'
    """
    suffix = next((end for end in _SUFFIXES if name.endswith(end)), "")
    return name.removesuffix(suffix).replace("_", " ").capitalize()


def read_number(name: str, text: str) -> float:
    """Read a number as people type it: plain, or with a unit of the field's dimension.

    Raises `ValueError` if the text is no such number.

    Examples
    --------
    >>> read_number("voltage_v", "0.1 kV")
    100.0
    """
    with suppress(ValueError):
        return float(text)
    suffix = next((end for end in _SUFFIXES if name.endswith(end)), None)
    if suffix is not None:
        with suppress(InputError):
            return _quantity(name, text, *_SUFFIXES[suffix])
    such = "" if suffix is None else f', or one with its unit such as "{_SUFFIXES[suffix][1]}"'
    raise ValueError(f"expected a number{such}, got {text!r:.80}{decimal_comma(text)}")


def factor_to(unit: str, own: str) -> float | None:
    """Return by how much a number in `unit` is multiplied to be in `own`; None for another kind.

    Examples
    --------
    >>> factor_to("um", "m"), factor_to("1/um", "/m"), factor_to("Ohm", "m")
    (1e-06, 1000000.0, None)
    """
    text = unit.strip().translate(_RAISED).replace("**", "^").removeprefix("rad")
    text = re.sub(r"[·*.⋅]", " ", text)
    read = _read_unit(text.removeprefix("1") if text.startswith("1/") else text)
    mine = _read_unit(own)
    if not text or read is None or mine is None or read[1] != mine[1]:
        return None
    return float(f"1e{read[0] - mine[0]}")


def decimal_comma(text: str) -> str:
    """Return advice on a number that was typed with a decimal comma; "" for other texts.

    Examples
    --------
    >>> decimal_comma("0,4")
    '; the decimal sign is a point: 0.4'
    """
    comma = _DECIMAL_COMMA.search(text)
    return f"; the decimal sign is a point: {comma[1]}.{comma[2]}" if comma else ""


def _quantity(place: str, text: str, unit: str, example: str) -> float:
    wrong = InputError(
        f'{place}: expected a number, or one with its unit such as "{example}", got {text!r:.80}'
        f"{decimal_comma(text)}"
    )
    match = _NUMBER.fullmatch(text)
    if match is None:
        raise wrong
    power, dimension = _read_unit(match[2]) or (0, {})
    own_power, own_dimension = _read_unit(unit) or (0, {})
    if dimension != own_dimension:
        raise wrong
    try:
        # Decimal powers of ten are exact: "0.2 um" is the float that 2e-7 is.
        return float(Decimal(match[1]).scaleb(power - own_power))
    except ArithmeticError:  # an exponent too large for a decimal
        raise wrong from None


def _read_unit(text: str) -> tuple[int, Dimension] | None:
    """Return power of ten and dimension of "kV/mm", "Ohm m" or "/m", and None for no unit."""
    power = 0
    dimension: dict[str, int] = {}
    for side, part in zip((1, -1), text.split("/"), strict=False):
        for factor in part.split():
            match = _FACTOR.fullmatch(factor)
            if match is None:
                return None
            exponent = side * (2 if match[4] else int(match[3] or 1))
            symbol = _SYMBOLS[match[2]]
            power += exponent * _PREFIXES[match[1]]
            dimension[symbol] = dimension.get(symbol, 0) + exponent
    return None if text.count("/") > 1 else (power, dimension)
