"""Results as JSON, as rows of a table and as a page, all from the fields of the result.

A result is a dataclass or a pydantic model. Programs read its fields by name (`record`). People
read a table (`row`) of the fields and properties whose annotation has a `Heading`.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from math import isfinite
from typing import TYPE_CHECKING, Any, get_type_hints

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STYLE = (
    "body{font:14px/1.4 system-ui,sans-serif;max-width:60em;margin:1em auto;padding:0 1em;"
    "color:#222}table{border-collapse:collapse;margin:.5em 0}td,th{padding:.1em .7em;"
    "text-align:left;border-bottom:1px solid #ddd}h1{font-size:1.4em}h2{font-size:1.1em}"
    "img{max-width:100%}small{color:#555}.passed{color:#1a6e1a}.provisional{color:#8a5a00}"
    ".failed{color:#a81111}@media print{body{max-width:none;font-size:11px}"
    "img,table,details[open]{break-inside:avoid}details:not([open]){display:none}}"
)


@dataclass(frozen=True)
class Heading:
    """How people see a field: ``error: Annotated[float, Heading("error [JND]", "+.2f")]``."""

    title: str
    """With the unit."""
    form: str = ""
    """A format; for a flag its two words, "off|on"; or a text with fields of the whole result,
    "{0.mean:+.2f} ± {0.uncertainty:.2f}". By default numbers have four digits."""
    missing: str = "-"
    """Shown for None and for numbers that are not finite."""

    def text(self, result: object, value: Any) -> str:
        """Return the cell of a result whose field has this value."""
        if value is None or (isinstance(value, float) and not isfinite(value)):
            return self.missing
        if "{" in self.form:
            return self.form.format(result)
        if isinstance(value, bool):
            return (self.form or "no|yes").split("|")[value]
        return format(value, self.form) if self.form else text(value)


class HeadingsOf(tuple[str, ...]):
    """Fields shown of an inner result: ``Annotated[Point, HeadingsOf(("number", "mu"))]``."""


def text(value: Any) -> str:
    """Return a value for people."""
    if value is None:
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def record(value: Any, only: Container[str] | None = None) -> Any:
    """Return a result, or results in lists and tables, as plain values for JSON.

    Numbers that are not finite become None. With `only`, a result has just these fields.
    """
    if _field_names(type(value)):
        plain: dict[str, Any] = {}
        for name, heading in _headings(type(value)).items():
            if isinstance(heading, HeadingsOf):
                plain |= record(getattr(value, name), heading)
            elif only is None or name in only:
                plain[name] = record(getattr(value, name))
        return plain
    if isinstance(value, Mapping):
        return {str(key): record(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [record(result) for result in value]
    return None if isinstance(value, float) and not isfinite(value) else value


def row(result: object, only: Container[str] | None = None) -> dict[str, str]:
    """Return a row of a table for people, by heading; of all fields, or of `only` these."""
    cells: dict[str, str] = {}
    for name, heading in _headings(type(result)).items():
        if isinstance(heading, HeadingsOf):
            cells |= row(getattr(result, name), heading)
        elif heading is not None and (only is None or name in only):
            cells[heading.title] = heading.text(result, getattr(result, name))
    return cells


def titles_of(kind: type) -> dict[str, str]:
    """Return the headings of a result's columns by field, as for the axes of a picture."""
    headings = _headings(kind).items()
    return {name: heading.title for name, heading in headings if isinstance(heading, Heading)}


def _field_names(kind: type) -> list[str]:
    """Return the fields of a result; an empty list for other classes."""
    return [*(getattr(kind, "model_fields", ()) or getattr(kind, "__dataclass_fields__", ()))]


def _headings(kind: type) -> dict[str, Heading | HeadingsOf | None]:
    """How each field and each property with a `Heading` is shown; None: to programs only."""
    hints = get_type_hints(kind, include_extras=True)
    hints = {name: hints[name] for name in _field_names(kind)}
    for base in reversed(kind.__mro__):
        for name, member in vars(base).items():
            if isinstance(member, property) and "Heading" in str(member.fget.__annotations__):
                hints[name] = get_type_hints(member.fget, include_extras=True)["return"]
    extras = {name: getattr(hint, "__metadata__", ()) for name, hint in hints.items()}
    return {
        name: next((mark for mark in those if isinstance(mark, Heading | HeadingsOf)), None)
        for name, those in extras.items()
    }


def page(title: str, parts: Iterable[str], verdict: str = "") -> str:
    """Return an HTML page of parts that are HTML; it loads nothing."""
    name = escape(title)
    judged = f': <span class="{verdict}">{verdict}</span>' if verdict else ""
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        f"<title>{name}</title><style>{_STYLE}</style></head><body><h1>{name}{judged}</h1>\n"
        + "\n".join(filter(None, parts))
        + "</body></html>\n"
    )


def table(title: str, rows: Sequence[Any]) -> str:
    """Return results, or mappings with the same keys, as a table under its title; "" without."""
    shown = [result if isinstance(result, Mapping) else row(result) for result in rows]
    if not shown:
        return ""
    head = "".join(f"<th>{escape(str(name))}</th>" for name in shown[0])
    lines = (
        "".join(f"<td>{escape(text(cell))}</td>" for cell in cells.values()) for cells in shown
    )
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    return f"{_headline(title)}<table><tr>{head}</tr>{body}</table>"


def part(title: str, rows: Sequence[Any]) -> str:
    """Return results as a table, or lines as a list, under a title; "" without."""
    return listed(title, rows) if rows and isinstance(rows[0], str) else table(title, rows)


def listed(title: str, lines: Iterable[str]) -> str:
    """Return lines as a list under its title; "" without."""
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return f"{_headline(title)}<ul>{items}</ul>" if items else ""


def paragraph(line: str) -> str:
    """Return a paragraph."""
    return f"<p>{escape(line)}</p>"


def picture(title: str, figure: Figure) -> str:
    """Return a figure under its title."""
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=110)
    source = f"data:image/png;base64,{base64.b64encode(png.getvalue()).decode()}"
    return f'{_headline(title)}<img alt="{escape(title)}" src="{source}">'


def _headline(title: str) -> str:
    return f"<h2>{escape(title)}</h2>" if title else ""
