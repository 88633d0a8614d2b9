"""No volt leaves the driver for a finger that does not touch, whatever a panel sends.

Random sequences of events go the whole way: decoder, renderer, wire, firmware, output. What truly
touches is known to who makes the events, by the rules of the kernel, of TUIO and of browsers.
`HAPTIX_SEQUENCES=100000 pytest tests/play/render/test_no_touch_no_volts.py` plays so many of each.
"""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

import haptix
from haptix.play.render import LiveRenderer, LiveSettings
from haptix.play.touch import TouchEvent
from tests.live_strokes import ALWAYS, FULL, RATE, REACTION_S
from tests.made_clients import node_tools
from tests.play.touch import panel_events, tuio_frames

SEQUENCES = int(os.environ.get("HAPTIX_SEQUENCES", "100"))
SESSION = 250  # sequences that one driver plays
REPORTS, INTERVAL_US = 10, 15_000
INTERVAL_S = INTERVAL_US / 1e6
# The reaction, the fade, and a step of the control points at either side.
SETTLES_S = REACTION_S + ALWAYS.fade_s + 0.002
PAUSE_S = 0.02  # between sequences


def kernel(protocol):
    def sequences(first, count):
        for seed in range(first, first + count):
            yield lambda at_s, seed=seed: [
                (bool(panel.touching), missed, found)
                for panel, found, _, missed in panel_events.reports(
                    seed, protocol, REPORTS, round(at_s * 1e6), INTERVAL_US
                )
            ]

    return sequences


def tables(first, count):
    for seed in range(first, first + count):
        yield lambda at_s, seed=seed: [
            (bool(touching), False, found)
            for touching, found, _ in tuio_frames.frames(seed, REPORTS, at_s, INTERVAL_S)
        ]


def pages(first, count):
    node_tools()
    program = Path(__file__).parents[1] / "touch" / "pointer_events.mjs"
    numbers = map(str, (first, count, REPORTS, INTERVAL_US / 1e3))
    done = subprocess.run(["node", program, *numbers], capture_output=True, check=True, text=True)
    for line in done.stdout.splitlines():
        yield lambda at_s, line=line: [
            (touching > 0, False, [pointer(at_s, *row) for row in found])
            for touching, found in json.loads(line)
        ]


def pointer(at_s, ms, touch_id, kind, x_px, y_px):
    return TouchEvent(at_s + ms / 1e3, touch_id, x_px / 10, y_px / 10, kind, None)


def play(surface, sequences):
    """Return (time [s], is touched, is felt) of each report, the output, and when it began."""
    device = haptix.open_device("mock:pace=stepped")
    settings = LiveSettings(sliding=ALWAYS, horizon_s=0.02, strict=False)
    told = []
    with LiveRenderer(surface, FULL, device, None, settings) as renderer:
        at_s = renderer.now_s() + PAUSE_S
        for sequence in sequences:
            for number, (touches, missed, found) in enumerate(sequence(at_s)):
                report_s = at_s + number * INTERVAL_S
                renderer.run_until(report_s)
                renderer.events(found)
                # A page says nothing of a finger that rests, which gets no volts in the end.
                moves = any(touch.kind != "up" for touch in found)
                told.append((report_s, touches, moves and touches and not missed))
            at_s += REPORTS * INTERVAL_S
            renderer.run_until(at_s)
            for touch_id in [each for each, _ in renderer._fingers.touches.active]:
                renderer.lift(at_s, touch_id)
            at_s += PAUSE_S
        renderer.run_until(at_s)
        assert not renderer.stats.underruns
        output_v = device.mock.output_v
        began_s = renderer.now_s() - output_v.size / RATE
    return told, output_v, began_s


@pytest.mark.parametrize(
    "sequences",
    [kernel("B"), kernel("A"), kernel("single"), tables, pages],
    ids=["B", "A", "single", "tuio", "page"],
)
def test_no_volt_without_a_touch(surface, sequences):
    for first in range(0, SEQUENCES, SESSION):
        some = sequences(first, min(SESSION, SEQUENCES - first))
        told, output_v, began_s = play(surface, some)
        for index, (at_s, touches, is_felt) in enumerate(told):
            start, end = (
                round((each - began_s) * RATE) for each in (at_s + SETTLES_S, at_s + INTERVAL_S)
            )
            peak_v = np.abs(output_v[start:end]).max()
            number = first + index // REPORTS
            if not touches:
                assert peak_v == 0.0, f"sequence {number}: {peak_v:g} V, and no finger touches"
            elif is_felt:  # so that what is silent is not right by being silent always
                assert peak_v > 100.0, f"sequence {number}: a finger touches and gets {peak_v:g} V"
