"""The report of a campaign: one HTML page with its counts, costs, pictures and failures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from haptix.campaign.kinds import Campaign
from haptix.errors import MissingExtraError, from_extra
from haptix.report_page import page, picture, table
from haptix.version import __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_FAILURES = 50


def report_html(campaign: Campaign, rows: Sequence[dict[str, Any]]) -> str:
    """Return the page.

    Parameters
    ----------
    campaign : Campaign
        The plan, which says what is drawn.
    rows : sequence of dict
        The table.
    """
    counts = Counter(row["status"] for row in rows)
    done = [row for row in rows if row["status"] == "done"]
    facts = {"kind": campaign.kind, "haptix": __version__, "tasks": len(rows), **counts}
    for name, text in (("cpu_seconds", "processor time [h]"), ("seconds", "time of tasks [h]")):
        facts[text] = f"{sum(_numbers(done, name)) / 3600:.4g}"
    facts["results [MB]"] = f"{sum(_numbers(done, 'bytes')) / 1e6:.4g}"
    if peaks := _numbers(done, "peak_bytes"):
        facts["largest memory of a worker [MB]"] = f"{max(peaks) / 1e6:.4g}"
    parts = [table([{"": name, "value": value} for name, value in facts.items()])]
    try:
        pictures = _pictures(campaign, done)
    except MissingExtraError as error:
        pictures = []
        parts.append(f"<p>Without pictures: {escape(str(error))}</p>")
    parts += [picture(title, figure) for title, figure in pictures]
    if wrong := [row for row in rows if row["status"] in ("failed", "set aside")]:
        kept = ("key", "status", "worker", "error")
        listed = [{name: row[name] for name in kept} for row in wrong[:_MOST_FAILURES]]
        parts.append(f"<h2>{len(wrong)} without results</h2>{table(listed)}")
    return page(campaign.name, parts)


def _pictures(campaign: Campaign, done: Sequence[dict[str, Any]]) -> list[tuple[str, Figure]]:
    pictures = []
    for name in (*campaign.shown, "cpu_seconds"):
        values = _numbers(done, name)
        if len(values) > 1:
            figure, axes = _panel()
            axes.hist(values, bins="auto" if len(set(values)) > 1 else 1)
            axes.set(xlabel=name, ylabel="tasks")
            pictures.append((f"{name}: {min(values):.4g} to {max(values):.4g}", figure))
    for x, y in campaign.maps:
        pairs = [
            (row[x], row[y]) for row in done if _is_number(row.get(x)) and _is_number(row.get(y))
        ]
        if len(pairs) > 1:
            figure, axes = _panel()
            axes.plot(*zip(*pairs, strict=True), ".")
            axes.set(xlabel=x, ylabel=y)
            for axis, column in zip("xy", zip(*pairs, strict=True), strict=True):
                if min(column) > 0 and max(column) > 10 * min(column):
                    axes.set(**{f"{axis}scale": "log"})
            pictures.append((f"{y} against {x}", figure))
    return pictures


def _panel() -> tuple[Figure, Any]:
    with from_extra("figures"):
        from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    return figure, figure.add_subplot()


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _numbers(rows: Sequence[dict[str, Any]], name: str) -> list[float]:
    return [row[name] for row in rows if _is_number(row.get(name))]
