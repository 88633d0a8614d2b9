"""A report as one HTML page: its tables and pictures are inside, and it loads nothing."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STYLE = (
    "body{font:15px/1.5 sans-serif;max-width:60em;margin:2em auto;padding:0 1em}"
    "table{border-collapse:collapse}td,th{padding:.2em .8em;text-align:left;"
    "border-bottom:1px solid #ccc}img{max-width:100%}"
)


def page(title: str, parts: Iterable[str]) -> str:
    """Return a page of parts that are HTML."""
    name = escape(title)
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{name}</title>'
        f"<style>{_STYLE}</style><h1>{name}</h1>{''.join(parts)}</html>\n"
    )


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows with the same columns as a table."""
    head = "".join(f"<th>{escape(str(name))}</th>" for name in rows[0])
    lines = ("".join(f"<td>{escape(str(value))}</td>" for value in row.values()) for row in rows)
    return f"<table><tr>{head}</tr>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"


def picture(title: str, figure: Figure) -> str:
    """Return a figure under its title."""
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=110)
    source = f"data:image/png;base64,{base64.b64encode(png.getvalue()).decode()}"
    return f'<h2>{escape(title)}</h2><img alt="{escape(title)}" src="{source}">'
