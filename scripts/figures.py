"""Figures of the pages: each has the command that made it, a commit, a date, and its sources.

    .venv/bin/python scripts/figures.py                 # which figures are older than their sources
    .venv/bin/python scripts/figures.py make contact    # make one anew, by its command
    .venv/bin/python scripts/figures.py write           # write the tables into the pages

`docs/figures.toml` holds them. A table in a page stands between two comments,
``<!-- figures: GROUP -->`` and ``<!-- end of figures -->``, and `write` fills it. A figure is older
than its sources once a file of them has another content than when it was made. That is told; of
one in a table it is an error when it is older than `GRACE_DAYS`, counted to the last commit, or at
a release. Other pages quote figures in their own words: a test holds them to `page` and `value`.
"""

from __future__ import annotations

import argparse
import datetime
import functools
import hashlib
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomlkit

ROOT = Path(__file__).parents[1]
KEPT = ROOT / "docs" / "figures.toml"
PAGES = (ROOT / "README.md", ROOT / "docs" / "verified.md")
GRACE_DAYS = 30
TABLE = re.compile(r"<!-- figures: (?P<group>\w+) -->\n.*?<!-- end of figures -->", re.S)


@dataclass(frozen=True)
class Figure:
    """One row: what it is, its value as the pages quote it, and how it was made."""

    name: str
    what: str
    value: str
    command: str
    commit: str
    date: datetime.date
    sources: tuple[str, ...]
    sha256: str  # of the sources when it was made; empty where they were not kept
    groups: tuple[str, ...] = ()  # the tables that show it
    page: str = ""  # the page that quotes its value in a sentence or table of its own
    find: tuple[str, ...] = ()  # patterns of its numbers in what the command prints
    text: str = ""  # its value, with {} for each number

    @property
    def is_current(self) -> bool:
        """Whether its sources are those that it was made from."""
        return self.sha256 == digest(self.sources)

    def is_stale(self, today: datetime.date) -> bool:
        """Whether a table shows it that has been older than its sources for too long."""
        return bool(self.groups) and not self.is_current and (today - self.date).days > GRACE_DAYS

    def value_of(self, printed: str) -> str:
        """Return the value in what the command printed: the largest number of each pattern."""
        numbers = []
        for pattern in self.find:
            found = re.findall(pattern, printed)
            if not found:
                raise ValueError(f"{self.name}: the command printed nothing like {pattern!r}")
            numbers.append(max(found, key=float))
        return self.text.format(*numbers)


def digest(sources: tuple[str, ...]) -> str:
    """Return the first 16 digits of the hash of files; of a folder all of Python and C."""
    total = hashlib.sha256()
    for source in sources:
        path = ROOT / source
        files = sorted(path.rglob("*.[pch]*")) if path.is_dir() else [path]
        for file in files:
            if file.suffix in (".py", ".c", ".h") or not path.is_dir():
                total.update(file.relative_to(ROOT).as_posix().encode())
                total.update(file.read_bytes().replace(b"\r\n", b"\n"))
    return total.hexdigest()[:16]


def read() -> dict[str, Figure]:
    """Return the figures by name."""
    kept: Any = tomlkit.parse(KEPT.read_text("utf-8")).unwrap()
    lists = ("sources", "groups", "find")
    return {
        name: Figure(name, **{k: tuple(v) if k in lists else v for k, v in row.items()})
        for name, row in kept.items()
    }


def rows(group: str, figures: dict[str, Figure], marked: bool = False) -> str:
    """Return a table of Markdown; where `marked`, it says whose sources changed since."""
    shown = [one for one in figures.values() if group in one.groups]
    if group == "readme":
        lines = ["| what | value | measured |", "|---|---|---|"]
        lines += [f"| {f.what} | {f.value} | {f.date} |" for f in shown]
        return "\n".join(lines)
    lines = ["| what | value | command | commit, date |", "|---|---|---|---|"]
    for f in shown:
        mark = "; the code has changed since" if marked and not f.is_current else ""
        lines.append(f"| {f.what} | {f.value} | `{f.command}` | {f.commit}, {f.date}{mark} |")
    return "\n".join(lines)


def filled(page: str, figures: dict[str, Figure], marked: bool = False) -> str:
    """Return the text of a page with its tables as the figures have them."""
    return TABLE.sub(
        lambda at: (
            f"<!-- figures: {at['group']} -->\n{rows(at['group'], figures, marked)}\n"
            "<!-- end of figures -->"
        ),
        page,
    )


def git(*arguments: str) -> str:
    """Return what git says, or nothing where there is none."""
    done = subprocess.run(
        ["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False
    )
    return done.stdout.strip()


def last_change() -> datetime.date:
    """Return the date of the last commit: an old checkout stays as right as it was."""
    said = git("log", "-1", "--format=%cs")
    return datetime.date.fromisoformat(said) if said else datetime.date.today()


@functools.cache  # one run for all its figures
def printed_by(command: str) -> str:
    """Run a command of ours and return what it printed."""
    return subprocess.run(
        [sys.executable, *command.split()], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout


def make(figure: Figure) -> None:
    """Run the command of a figure and keep what it printed, with commit and date."""
    if not figure.find:
        raise SystemExit(f"{figure.name}: run its command by hand, then edit {KEPT.name}")
    kept: Any = tomlkit.parse(KEPT.read_text("utf-8"))
    kept[figure.name]["value"] = figure.value_of(printed_by(figure.command))
    kept[figure.name]["commit"] = git("rev-parse", "--short=7", "HEAD") or "none"
    kept[figure.name]["date"] = datetime.date.today()
    kept[figure.name]["sha256"] = digest(figure.sources)
    KEPT.write_text(tomlkit.dumps(kept), encoding="utf-8")


def main() -> None:
    """Tell, make or write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("action", nargs="?", choices=("tell", "make", "write"), default="tell")
    parser.add_argument("names", nargs="*", help="the figures to make anew")
    asked = parser.parse_args()
    if unknown := set(asked.names) - set(read()):
        raise SystemExit(f"{', '.join(sorted(unknown))}: expected one of {', '.join(read())}")
    if asked.action == "make":
        for name in asked.names or [name for name, one in read().items() if one.find]:
            make(read()[name])
    if asked.action != "tell":
        for page in PAGES:
            page.write_text(filled(page.read_text("utf-8"), read()), encoding="utf-8")
    for figure in read().values():
        if not figure.is_current:
            age = (last_change() - figure.date).days
            sys.stdout.write(f"{figure.name}: its sources changed, it is {age} days old\n")


if __name__ == "__main__":
    main()
