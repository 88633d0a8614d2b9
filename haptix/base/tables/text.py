"""Text of any layout: headings above numbers, in columns that one sign parts."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import nan
from pathlib import Path

import numpy as np

from haptix.base.checks import Array
from haptix.base.errors import FileFormatError
from haptix.base.tables.table import (
    FEWEST_SAMPLES,
    OF_SIGNALS,
    TIMES_S,
    LabTable,
    distinct,
    known_unit,
    split_unit,
)

_LOOKED_AT = 200  # lines, from which a layout is found
_DELIMITERS = {"\t": "tabs", ";": "semicolons", ",": "commas", "|": "bars", " ": "spaces"}
_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?\s*|\s*[+-]?(nan|inf)\s*", re.I)
_CLOCK = re.compile(
    r"\s*(?:(?P<day>\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4})[T ]\s*)?"
    r"(?P<h>\d{1,2}):(?P<m>\d{2}):(?P<s>\d{2}(?:[.,:]\d+)?)\s*(?P<half>[ap]\.?m\.?)?"
    r"\s*(?:Z|[+-]\d{2}:?\d{2})?\s*",
    re.I,
)
_NAMED = re.compile(r"#\s*NAME(\d+)\s*=\s*(.+?)\s*")  # of a column, as PIPython writes
_OF_SAMPLING = r"(?:(?:rdt|daq|data) )?(?:sampl(?:e|ing)|scan|acquisition|abtast)[ _-]?"
_STATED_UNIT = r"(?:[ _]*[(\[](?P<unit>[^()\[\]]*)[)\]]|[ _](?P<after>[mu]?s|[kM]?Hz))?"
_RATE = re.compile(rf"(?:{_OF_SAMPLING}(?:rate|frequency|frequenz)|fs){_STATED_UNIT}", re.I)
_COMMENT = re.compile(r"#+\s*|%+(?:\s+|$)")
_STEP = re.compile(
    rf"(?:{_OF_SAMPLING}(?:time|interval|intervall|period)|interval|delta.?[tx]|dt){_STATED_UNIT}",
    re.I,
)
_RATE_UNIT = re.compile(
    r"(?P<prefix>[kKMG]?)(?:Hz|hz|Sa?/s(?:ec)?|samples?/s(?:ec(?:ond)?)?|sps|SPS)|1/s"
)
_QUANTITY = re.compile(r"(?P<number>[+\d.,]+(?:[eE][+-]?\d+)?)\s*(?P<unit>[^\d\s.,:].*)?")
# Digits with signs between the thousands.
_GROUPED = re.compile(
    r"\s*[+-]?[1-9]\d{0,2}(?:(?:[,' \u00a0\u2019\u202f]\d{3})+(?:\.\d*)?"
    r"|(?:[.' \u00a0\u2019\u202f]\d{3})+(?:,\d*)?)\s*"
)
_OF_DIGITS = re.compile(r"[+-]?\d[\d.,' \u00a0\u2019\u202f]*(?:[eE][+-]?\d+)?")
_DAY_S = 86_400.0
_PREFIXES = {"": 1.0, "k": 1e3, "K": 1e3, "M": 1e6, "G": 1e9}


@dataclass(frozen=True)
class _Layout:
    """Where the columns of a text are."""

    delimiter: str
    has_commas: bool  # in place of decimal points
    names: list[str]
    first: int  # line of the first numbers
    width: int
    units: dict[str, str]
    above: list[str]
    has_headings: bool


def of_text(
    path: str | Path, text: str, names: Sequence[str] | None, skip_rows: int, delimiter: str | None
) -> LabTable:
    """Read a text that has been decoded; the parameters are those of `read_table`."""
    lines = text.replace("\N{MINUS SIGN}", "-").splitlines()[skip_rows:]
    at = [number for number, line in enumerate(lines, skip_rows + 1) if line.strip()]
    lines = [line for line in lines if line.strip()]
    layout = _layout(lines, delimiter)
    if layout is None:
        raise FileFormatError(
            f"{path}: expected a table of numbers below a line of headings, with "
            f"{', '.join(_DELIMITERS.values())} between the columns; decimal commas need another "
            "sign between the columns"
        )
    body = lines[layout.first :]
    while body and len(_cells(body[-1], layout.delimiter)) < layout.width:
        body.pop()  # where a recording broke off
    if len(body) < FEWEST_SAMPLES:
        raise FileFormatError(
            f"{path}: expected a line of headings and {FEWEST_SAMPLES} samples or more, got "
            f"{len(lines)} lines"
        )
    wanted = layout.names
    if names is not None:
        wanted = LabTable(dict.fromkeys(wanted, np.empty(0))).all_named(names, path)
    waveforms = _waveforms(path, layout)
    columns, units = _values(
        path, body, at[layout.first :], layout, wanted, names is not None, is_ragged=bool(waveforms)
    )
    columns = {name: columns[name] for name in wanted if name in columns}
    factors, rate_hz = _stated(layout)
    for name in columns:
        axis = split_unit(name)[0][:1].upper()
        if axis in factors and re.fullmatch(r"[FT][xyz]", split_unit(name)[0], re.I):
            factor, unit = factors[axis]
            columns[name] = columns[name] / factor
            units = {name: unit, **units}
    understood = [
        f"{_DELIMITERS.get(layout.delimiter, layout.delimiter)} between {layout.width} columns, "
        f"decimal {'commas' if layout.has_commas else 'points'}, {len(body)} samples from line "
        f"{at[layout.first]} on"
    ]
    if not layout.has_headings:
        understood.append("no headings: the columns are called 1, 2, ...")
    if factors:
        understood.append("counts divided by the counts per unit above the columns")
    if waveforms:
        understood.append("each column from its own start on, at its own rate, as stated above")
    elif rate_hz:
        understood.append(f"{rate_hz:g} samples a second, as stated above the columns")
    times = {
        name: began_s + step_s * np.arange(float(len(columns[name])))
        for name, (began_s, step_s) in waveforms.items() if name in columns
    }  # fmt: skip
    return LabTable(columns, units, times, None if waveforms else rate_hz, (*understood,))


def _waveforms(path: str | Path, layout: _Layout) -> dict[str, tuple[float, float]]:
    """Start and step [s] of each column, where LabVIEW's waveforms have those of their own."""
    rows = {
        label.strip().lower(): cells
        for label, *cells in (_cells(line, layout.delimiter) for line in layout.above)
        if len(cells) == len(layout.names)
    }
    if "t0" not in rows or "delta t" not in rows:
        return {}
    starts = np.zeros(len(rows["t0"]))
    if all(map(_CLOCK.fullmatch, rows["t0"])):
        starts = np.array([_clock_s(path, [cell], "t0")[0] for cell in rows["t0"]])
        starts = (starts - starts[0] + _DAY_S / 2) % _DAY_S  # over midnight as well
    steps = [_number(cell, layout.has_commas) for cell in rows["delta t"]]
    if not min(steps) > 0 or (np.ptp(starts) == 0 and len(set(steps)) == 1):
        return {}
    own = zip((starts - starts.min()).tolist(), steps, strict=True)
    return dict(zip(layout.names, own, strict=True))


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    if '"' in line:
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    return line.split(delimiter)


def _is_value(cell: str, has_commas: bool) -> bool:
    plain = cell.replace(",", ".") if has_commas else cell
    return bool(_NUMBER.fullmatch(plain) or _CLOCK.fullmatch(cell))


def _is_number(cell: str) -> bool:
    """Whether a cell is a number, with a decimal sign and one between thousands or either."""
    is_one = _NUMBER.fullmatch(cell.replace(",", ".")) or _GROUPED.fullmatch(cell)
    return bool(is_one and _OF_DIGITS.fullmatch(cell.strip()))


def _layout(lines: Sequence[str], delimiter: str | None) -> _Layout | None:
    """Find the layout that makes the most cells of the first lines numbers."""
    looked = lines[:_LOOKED_AT]
    best: tuple[tuple[float, ...], _Layout] | None = None
    for sign in (delimiter,) if delimiter else _DELIMITERS:
        rows = [_cells(line, sign) for line in looked]
        for has_commas in (False, True):
            plain = [sum(_is_value(cell, has_commas) for cell in row) for row in rows]
            # Thousands with signs are numbers as well, though they are refused later.
            grouped = [
                sum(bool(_GROUPED.fullmatch(c)) and not _is_value(c, has_commas) for c in row)
                for row in rows
            ]
            counts = [sum(each) for each in zip(plain, grouped, strict=True)]
            # Most of the cells of a line of numbers are numbers, two of the samples of a scope.
            filled = [sum(bool(cell.strip()) for cell in row) for row in rows]
            full = [2 * c > n for c, n in zip(counts, filled, strict=True)]
            widths = Counter(len(row) for row, is_full in zip(rows, full, strict=True) if is_full)
            if not widths:
                continue
            width = widths.most_common(1)[0][0]
            fits = [
                f and len(row) == width and not row[0].rstrip().endswith("=")
                for f, row in zip(full, rows, strict=True)
            ]
            # Settings above the samples begin with a word, where most lines have a number.
            begin = [row[0] for fit, row in zip(fits, rows, strict=True) if fit]
            if 2 * sum(_is_value(cell, has_commas) for cell in begin) > len(begin):
                fits = [
                    fit and (not row[0].strip() or _is_value(row[0], has_commas))
                    for fit, row in zip(fits, rows, strict=True)
                ]
            fitting = [each for each, fit in zip(counts, fits, strict=True) if fit]
            cells = sum(n for n, fit in zip(filled, fits, strict=True) if fit)
            certain = sum(n for n, fit in zip(plain, fits, strict=True) if fit)
            score = (sum(fitting), sum(fitting) / max(cells, 1), certain)
            if best is not None and score <= best[0]:
                continue
            runs = [k for k in range(len(rows)) if all(fits[k : k + 3])]
            if not runs:
                continue
            first = runs[0]
            best = (score, _layout_of(rows, first, width, sign, has_commas))
    return None if best is None else best[1]


def _layout_of(
    rows: Sequence[list[str]], first: int, width: int, delimiter: str, has_commas: bool
) -> _Layout:
    above = [[cell.strip().strip('"') for cell in row] for row in rows[:first]]
    for k in range(max(first - 2, 0), first):  # headings behind a sign of comments
        if above[k] and (sign := _COMMENT.match(above[k][0])):
            row = [*filter(None, [above[k][0][sign.end() :]]), *above[k][1:]]
            if len(row) == width and "=" not in row:
                above[k] = row
    head = [k for k, row in enumerate(above) if len(row) == width and row[0] != "#"][-2:]
    units: dict[str, str] = {}
    names = [str(k + 1) for k in range(width)]
    if head:
        row = above[head[-1]]
        is_units = (
            len(head) == 2
            and head[1] == head[0] + 1
            and all(map(_is_unit, row))
            and any(known_unit(cell) in OF_SIGNALS for cell in row)
        )
        names = above[head[0]] if is_units else row
        names = distinct([name or str(k + 1) for k, name in enumerate(names)])
        if is_units:
            units = {n: known_unit(u) for n, u in zip(names, row, strict=True) if known_unit(u)}
    labelled = {row[0]: row[1:] for row in above if len(row) == width and row[0].endswith("=")}
    if titles := labelled.get("ChannelTitle="):  # of LabChart
        names = distinct(["Time", *titles])
        cells = map(known_unit, labelled.get("UnitName=", []))
        units = {name: unit for name, unit in zip(names[1:], cells, strict=False) if unit}
    if names[0] == "%time":  # of rostopic
        units["%time"] = "ns"
    lines = [delimiter.join(row) for row in above]
    named = {match[1]: match[2] for line in lines if (match := _NAMED.fullmatch(line))}
    names = [named.get(str(k), name) for k, name in enumerate(names)]
    units = {name: unit for name in names if (unit := split_unit(name)[1])} | units
    return _Layout(delimiter, has_commas, names, first, width, units, lines, bool(head or named))


def _is_unit(cell: str) -> bool:
    """Whether a cell below a heading is a unit: empty, in brackets, or short without a digit."""
    is_short = bool(re.fullmatch(r"[^\W\d]{1,3}|-|%", cell))
    return not cell or cell[0] in "([" or is_short or known_unit(cell) in OF_SIGNALS


def _values(
    path: str | Path,
    body: list[str],
    at: Sequence[int],
    layout: _Layout,
    wanted: Sequence[str],
    must_be: bool,
    is_ragged: bool,
) -> tuple[dict[str, Array], dict[str, str]]:
    """Numbers of the wanted columns; where one must be, a cell that is none is an error.

    Ragged columns end before empty cells.
    """
    sign, units = layout.delimiter, dict(layout.units)
    first = _cells(body[0], sign)
    numeric, clocks = [], []
    for name in wanted:
        k = layout.names.index(name)
        if _CLOCK.fullmatch(first[k]):
            clocks.append(k)
        elif must_be or _is_value(first[k], layout.has_commas) or _GROUPED.fullmatch(first[k]):
            numeric.append(k)
    if layout.has_commas:
        _check_one_sign(path, body, at, layout)
    found: dict[str, Array] = {}
    try:
        text = [line.replace(",", ".") for line in body] if layout.has_commas else body
        if layout.has_commas and sign == ",":
            raise ValueError
        numbers = np.loadtxt(
            text, delimiter=None if sign == " " else sign, usecols=numeric, ndmin=2, comments=None,
            quotechar='"',
        )  # fmt: skip
        found = {layout.names[k]: numbers[:, j] for j, k in enumerate(numeric)}
    except ValueError:
        rows = [_cells(line, sign) for line in body]
        for k in numeric:
            cells = [row[k] if k < len(row) else "" for row in rows]
            while is_ragged and cells and not cells[-1].strip():
                cells.pop()
            values = np.array([_number(cell, layout.has_commas) for cell in cells])
            for j in np.flatnonzero(np.isnan(values)).tolist():
                if _OF_DIGITS.fullmatch(cells[j].strip()):
                    raise _of_two_signs(path, at[j], {layout.names[k]: cells[j]}) from None
            if (bad := np.flatnonzero(np.isnan(values))).size and not must_be:
                if len(bad) > len(values) / 2:
                    continue
            elif bad.size and not cells[bad[0]].strip().lower().endswith("nan"):
                raise FileFormatError(
                    f"{path}, sample {bad[0] + 1} (about line {at[bad[0]]}): expected a number in "
                    f"column {layout.names[k]!r}, got {cells[bad[0]]!r}"
                ) from None
            found[layout.names[k]] = values
    for k in numeric:
        values = found.get(layout.names[k], np.empty(0))
        if _may_be_grouped(values):
            cells = [_cells(line, sign)[k].strip(" +-") for line in body[: len(values)]]
            grouped = [j for j, cell in enumerate(cells) if _GROUPED.fullmatch(cell)]
            whole = sum(cell.isdecimal() and len(cell) <= 3 for cell in cells)
            if whole and len(grouped) + whole == len(cells):
                raise _of_two_signs(path, at[grouped[0]], {layout.names[k]: cells[grouped[0]]})
    for k in clocks:
        cells = [_cells(line, sign)[k] for line in body]
        found[layout.names[k]] = _clock_s(path, cells, layout.names[k])
        units[layout.names[k]] = "s"
    return found, units


def _check_one_sign(path: str | Path, body: list[str], at: Sequence[int], layout: _Layout) -> None:
    """Raise `FileFormatError` where points stand beside decimal commas."""
    first: FileFormatError | None = None
    for j, line in enumerate(body):
        cells = _cells(line, layout.delimiter) if "." in line else []
        if not any("." in cell and _is_number(cell) for cell in cells):  # a date may have points
            continue
        row = {n: c for n, c in zip(layout.names, cells, strict=False) if _is_number(c)}
        signs = {sign: name for name, cell in row.items() for sign in ",." if sign in cell}
        if "," in signs:
            raise _of_two_signs(path, at[j], {name: row[name] for name in signs.values()})
        first = first or _of_two_signs(path, at[j], {signs["."]: row[signs["."]]})
    if first is not None:
        raise first


def _may_be_grouped(values: Array) -> bool:
    """Whether "1.234" in a column may be 1234: it has whole numbers, and thousandths above 1."""
    size = np.abs(values[np.isfinite(values)])
    parted = size[size % 1 != 0]
    thousandths = size * 1000
    return bool(
        parted.size
        and parted.min() >= 1
        and (np.abs(thousandths - np.round(thousandths)) <= 1e-6 * thousandths).all()
    )


def _of_two_signs(path: str | Path, line: int, cells: Mapping[str, str]) -> FileFormatError:
    got = " and ".join(f"{cell.strip()!r} in column {name!r}" for name, cell in cells.items())
    return FileFormatError(
        f"{path}, about line {line}: expected one decimal sign and none between thousands, got "
        f"{got}; export again without a sign between thousands (of a spreadsheet: as General)"
    )


def _number(cell: str, has_commas: bool) -> float:
    plain = cell.replace(",", ".") if has_commas else cell
    try:
        return float(plain.replace("d", "e").replace("D", "e"))
    except ValueError:
        return nan


def _clock_s(path: str | Path, cells: Sequence[str], name: str) -> Array:
    """Seconds since the first midnight, over later ones as well."""
    times = np.empty(len(cells))
    for k, cell in enumerate(cells):
        match = _CLOCK.fullmatch(cell)
        if match is None:
            raise FileFormatError(
                f"{path}, sample {k + 1}: expected a time of day in column {name!r}, got {cell!r}"
            )
        whole, _, rest = re.sub("[,:]", ".", match["s"]).partition(".")
        hour = int(match["h"])
        if match["half"]:
            hour = hour % 12 + 12 * (match["half"][0] in "pP")
        times[k] = 3600 * hour + 60 * int(match["m"]) + float(f"{whole}.{rest or 0}")
    # A day later, not a clock that was set back by less.
    days = np.cumsum(np.diff(times, prepend=times[0]) < -_DAY_S / 2)
    return np.asarray(times + _DAY_S * days)


def _stated(layout: _Layout) -> tuple[dict[str, tuple[float, str]], float | None]:
    """Counts per unit of force and torque, and the rate, as instruments state them.

    The demonstration program of ATI's network sensors writes counts, and "Counts per Unit Force",
    "Force Units" and "RDT Sample Rate" above them; LabVIEW's waveforms have "delta t", arrays of
    PI's stages "SAMPLE_TIME".
    """
    stated: dict[str, str] = {}
    signs = "[:=\t]" if layout.delimiter == " " else f"[:=]|{re.escape(layout.delimiter)}"
    for line in layout.above:
        key, *rest = re.split(signs, line.removeprefix("#"), maxsplit=1)
        cells = [cell.strip() for cell in "".join(rest).split(layout.delimiter)]
        # Waveforms repeat it for each column.
        stated[key.strip()] = " ".join(dict.fromkeys(cell for cell in cells if cell))
    plain = {key.lower(): text for key, text in stated.items()}
    factors: dict[str, tuple[float, str]] = {}
    for what, axis in (("force", "F"), ("torque", "T")):
        counts, _ = _quantity(plain.get(f"counts per unit {what}", ""), layout.has_commas)
        if counts > 0:
            factors[axis] = counts, known_unit(plain.get(f"{what} units", ""))
    rates = set[float]()
    for key, text in stated.items():
        value, unit = _quantity(text, layout.has_commas)
        is_rate, is_step = _RATE.fullmatch(key), _STEP.fullmatch(key)
        named = is_rate or is_step
        if named is None or not value > 0:
            continue
        units = {known_unit(each) for each in (named["unit"], named["after"], unit) if each}
        unit = units.pop() if units else ""
        if units:  # two that differ
            continue
        of_rate = _RATE_UNIT.fullmatch(unit or "Hz")
        if is_rate and of_rate:
            rates.add(float(f"{value * _PREFIXES[of_rate['prefix'] or '']:.9g}"))
        elif is_step and (unit or "s") in TIMES_S:
            rates.add(float(f"{1 / (value * TIMES_S[unit or 's']):.9g}"))
    return factors, rates.pop() if len(rates) == 1 else None


def _quantity(text: str, has_commas: bool) -> tuple[float, str]:
    """Number and unit of a value above the columns; NaN where it may be read in two ways."""
    match = _QUANTITY.fullmatch(text.strip())
    if match is None:
        return nan, ""
    number, unit = match["number"], (match["unit"] or "").strip()
    if has_commas:  # "5.000" is five, of a program that always writes points, or five thousand
        is_unclear = "." in number and bool("," in number or _GROUPED.fullmatch(number))
    else:
        before = number.partition(",")[0]
        is_unclear = before != number and ("." in before or not _GROUPED.fullmatch(number))
    plain = number.replace(",", "." if has_commas else "")
    return nan if is_unclear else _number(plain, False), unit
