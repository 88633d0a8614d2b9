"""The report of a campaign: one HTML page with its counts, costs, pictures and failures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from haptix.campaign.kinds import Campaign
from haptix.errors import MissingExtraError, from_extra
from haptix.report import page, paragraph, picture, table
from haptix.version import __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_FAILURES = 50


def report_html(campaign: Campaign, rows: Sequence[dict[str, Any]]) -> str:
    """Return the page of a campaign, which says what is drawn, and its table."""
    done = [row for row in rows if row["status"] == "done"]
    counts = Counter(row["status"] for row in rows)
    facts = {"kind": campaign.kind, "haptix": __version__, "tasks": len(rows), **counts}
    for name, text in (("cpu_seconds", "processor time [h]"), ("seconds", "time of tasks [h]")):
        facts[text] = f"{sum(_numbers(done, name)) / 3600:.4g}"
    facts["results [MB]"] = f"{sum(_numbers(done, 'bytes')) / 1e6:.4g}"
    if peaks := _numbers(done, "peak_bytes"):
        facts["largest memory of a worker [MB]"] = f"{max(peaks) / 1e6:.4g}"
    parts = [table("", [{"": name, "value": value} for name, value in facts.items()])]
    try:
        parts += [picture(title, figure) for title, figure in _pictures(campaign, done)]
    except MissingExtraError as error:
        parts.append(paragraph(f"Without pictures: {error}"))
    if wrong := [row for row in rows if row["status"] in ("failed", "set aside")]:
        kept = ("key", "status", "worker", "error")
        listed = [{name: row[name] for name in kept} for row in wrong[:_MOST_FAILURES]]
        parts.append(table(f"{len(wrong)} without results", listed))
    return page(campaign.name, parts)


def _pictures(campaign: Campaign, done: Sequence[dict[str, Any]]) -> Iterator[tuple[str, Figure]]:
    with from_extra("figures"):
        from matplotlib.figure import Figure

    shown = [(name, "tasks") for name in (*campaign.shown, "cpu_seconds")]
    for x, y in (*shown, *campaign.maps):
        names = (x,) if y == "tasks" else (x, y)
        rows = [row for row in done if all(_is_number(row.get(name)) for name in names)]
        if len(rows) < 2:
            continue
        figure = Figure(figsize=(6.4, 3.6), layout="constrained")
        axes = figure.add_subplot()
        axes.set(xlabel=x, ylabel=y)
        values = _numbers(rows, x)
        if y == "tasks":
            axes.hist(values, bins="auto" if len(set(values)) > 1 else 1)
            yield f"{x}: {min(values):.4g} to {max(values):.4g}", figure
            continue
        axes.plot(values, _numbers(rows, y), ".")
        for axis, column in (("x", values), ("y", _numbers(rows, y))):
            if min(column) > 0 and max(column) > 10 * min(column):
                axes.set(**{f"{axis}scale": "log"})
        yield f"{y} against {x}", figure


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _numbers(rows: Sequence[dict[str, Any]], name: str) -> list[float]:
    return [row[name] for row in rows if _is_number(row.get(name))]
