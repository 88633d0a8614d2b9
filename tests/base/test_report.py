"""Results: rows for people, plain values for programs, and pages."""

import json
from dataclasses import dataclass
from html.parser import HTMLParser
from math import inf, nan
from typing import Annotated

import pytest
from pydantic import BaseModel

from haptix.base.report import Heading, HeadingsOf, listed, page, paragraph, record, row, table
from haptix.base.terminal import show


class Place(BaseModel):
    name: Annotated[str, Heading("place")]
    height_m: Annotated[float, Heading("height [m]")] = 0.0


@dataclass(frozen=True)
class Reading:
    place: Annotated[Place, HeadingsOf(("name",))]
    mean: Annotated[float, Heading("mean [V]", "{0.mean:+.1f} ± {0.spread:.1f}")]
    spread: float
    is_good: Annotated[bool, Heading("good")]
    is_on: Annotated[bool, Heading("switch", "off|on")]
    share: Annotated[float | None, Heading("share", ".1%", "not seen")] = None
    others: tuple["Place", ...] = ()

    @property
    def most(self) -> Annotated[float, Heading("at most [V]", ".1f")]:
        return self.mean + self.spread

    @property
    def least(self) -> float:
        return self.mean - self.spread


GOOD = Reading(Place(name="left"), 1.25, 0.5, True, False, 0.123456, (Place(name="b", height_m=2),))


def test_a_row_has_a_cell_for_each_column_and_no_other():
    assert row(GOOD) == {
        "place": "left",
        "mean [V]": "+1.2 ± 0.5",
        "good": "yes",
        "switch": "off",
        "share": "12.3%",
        "at most [V]": "1.8",
    }
    assert row(GOOD, ("share",)) == {"place": "left", "share": "12.3%"}


@pytest.mark.parametrize("share", [None, nan, inf])
def test_what_is_no_number_says_so(share):
    unseen = Reading(Place(name="left"), 1.0, 0.5, False, True, share)
    assert row(unseen)["share"] == "not seen"
    assert record(unseen)["share"] is None


def test_a_record_has_all_fields_and_the_properties_that_are_columns():
    assert record({3: [GOOD]}) == {
        "3": [
            {
                "name": "left",
                "mean": 1.25,
                "spread": 0.5,
                "is_good": True,
                "is_on": False,
                "share": 0.123456,
                "others": [{"name": "b", "height_m": 2.0}],
                "most": 1.75,
            }
        ]
    }


def test_a_terminal_shows_rows_or_records(capsys):
    show("readings", [GOOD], False)
    shown = capsys.readouterr().out
    assert "at most [V]" in shown
    assert "+1.2 ± 0.5" in shown
    show("readings", [GOOD], True)
    assert json.loads(capsys.readouterr().out) == [record(GOOD)]
    show("places", [GOOD.place], False)
    assert "height [m]" in capsys.readouterr().out  # small letters in brackets are markup to rich


class Words(HTMLParser):
    def __init__(self):
        super().__init__()
        self.words, self.open = [], []

    def handle_starttag(self, tag, attrs):
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag if tag in self.open else tag == "html"

    def handle_data(self, data):
        if data.strip() and self.open[-1] != "style":
            self.words.append(data)


def test_a_page_escapes_what_it_is_given_and_leaves_out_what_is_empty():
    parts = [
        paragraph("1 < 2"),
        listed("Why <b>", ["a & b"]),
        listed("Nothing", []),
        table("None", []),
        table("<i>", [{"<u>": None, "x": 0.123456}]),
    ]
    words = Words()
    words.feed(page("A <b>", parts, "failed"))
    assert words.words == [
        *("A <b>", "A <b>: ", "failed", "1 < 2", "Why <b>", "a & b"),
        *("<i>", "<u>", "x", "-", "0.1235"),
    ]
