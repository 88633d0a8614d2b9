"""Strokes of people on touchscreens, of recordings that others published; see --help.

    .venv/bin/python benchmarks/recorded_strokes.py fetch    # 60 MB, by git
    .venv/bin/python benchmarks/recorded_strokes.py kernel   # are they read as Linux reads them?

The recordings are those of https://github.com/bentiss/hid-devices: what 91 touch panels sent over
USB or I2C while somebody dragged one finger across, then two, then ten, by hid-recorder. What
Linux 3.6 to 3.15 made of most of them stands beside them, by evemu-record. They are fetched into
haptix' cache at one commit, and no part of them is in this repository. `prediction.py --recorded`
has what is computed from them.
"""

import argparse
import subprocess
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
from scipy.interpolate import BSpline, make_smoothing_spline

from haptix.base.checks import Array
from haptix.base.errors import HaptixError
from haptix.base.files import cache_folder
from haptix.play.touch import TouchEvent, read_recording

SOURCE = "https://github.com/bentiss/hid-devices"
COMMIT = "547829228561cf4ee613b8ad5dee0244f6b61a8c"

LEAST_REPORTS, LEAST_S, LEAST_MM = 20, 0.3, 20.0
LONGEST_GAP_S, FASTEST_MM_S, LEAST_STEP_S = 0.1, 3000.0, 0.004
HALF_HZ = 15.0
"""The reference follows half of a motion of this frequency: hands move up to some 6 Hz."""


class Stroke(NamedTuple):
    """Reports of one finger from down to up, and its path by all of them."""

    events: list[TouchEvent]
    path: BSpline
    """Place [mm], shape (n, 2), by the time of a report [s], shape (n,): a cubic spline."""

    @classmethod
    def of(cls, events: list[TouchEvent]) -> Self | None:
        """Return a stroke; None for one that is short or that no finger made."""
        t_s, first = np.unique([event.t_s for event in events], return_index=True)
        if len(t_s) < LEAST_REPORTS or t_s[-1] - t_s[0] < LEAST_S:
            return None
        events = [events[i] for i in first]
        places = np.array([event[2:4] for event in events])
        gaps_s = np.diff(t_s)
        fastest = (np.hypot(*np.diff(places, axis=0).T) / gaps_s.clip(LEAST_STEP_S)).max()
        if np.hypot(*np.ptp(places, axis=0)) < LEAST_MM:
            return None
        if gaps_s.max() > LONGEST_GAP_S or fastest > FASTEST_MM_S:
            return None  # the panel lost the finger, or took another for it
        return cls(events, smooth(t_s, places))

    @property
    def times_s(self) -> tuple[float, float]:
        """First and last report."""
        return self.events[0].t_s, self.events[-1].t_s


def smooth(t_s: Array, places: Array) -> BSpline:
    """Return a path through reports by all of them, also later ones.

    A cubic smoothing spline. For reports dt apart it passes ``1 / (1 + (f / HALF_HZ)^4)`` of a
    motion of frequency f.
    """
    interval_s = (t_s[-1] - t_s[0]) / (len(t_s) - 1)
    return make_smoothing_spline(t_s, places, lam=(2 * np.pi * HALF_HZ) ** -4 / interval_s)


def strokes(file: Path) -> Iterator[Stroke]:
    """Yield the strokes of a recording whose panel states its size; else `InputError`."""
    down: dict[int, list[TouchEvent]] = defaultdict(list)
    for event in read_recording(file):
        if event.kind == "up":
            if (stroke := Stroke.of(down.pop(event.touch_id, []))) is not None:
                yield stroke
        else:
            down[event.touch_id].append(event)


def folder() -> Path:
    """Return where the recordings are."""
    return cache_folder() / "hid-devices"


def recordings() -> list[Path]:
    """Return the recordings of touch panels."""
    found = sorted(folder().glob("events/multitouch/*/*.hid"))
    if not found:
        raise SystemExit(f"no recordings: run {Path(__file__).name} fetch")
    return found


def fetch(source: str) -> None:
    """Fetch the recordings of one commit."""
    git = ["git", "-C", str(folder())]
    folder().mkdir(parents=True, exist_ok=True)
    subprocess.run([*git, "init", "-q"], check=True)
    subprocess.run([*git, "fetch", "-q", "--depth", "1", source, COMMIT], check=True)
    subprocess.run([*git, "checkout", "-q", COMMIT], check=True)


def touches(file: Path) -> tuple[int, set[tuple[float, float]]]:
    """Return the number of touches, and their places by hundredths of 500 x 280 mm."""
    events = read_recording(file, 500.0, 280.0)
    places = {(round(e.x_mm, 2), round(e.y_mm, 2)) for e in events if e.kind != "up"}
    return sum(event.kind == "down" for event in events), places


def compare_with_the_kernel() -> None:
    """Print, for each panel, the touches that haptix reads and those that Linux told."""
    alike = compared = 0
    print("| panel | touches | of Linux | its places that haptix has too |\n|---|---|---|---|")
    for file in recordings():
        told = []
        for other in sorted(folder().glob(f"events/expected_evemu/*/{file.stem}_*.ev")):
            try:
                told.append(touches(other))
            except HaptixError:
                continue  # of another of its devices, such as a mouse
        if not told:
            continue
        try:
            count, places = touches(file)
        except HaptixError:
            count, places = 0, set()
        # Versions of Linux differ; that which is nearest.
        of_linux, known = min(told, key=lambda each: abs(each[0] - count))
        share = len(places & known) / len(known)
        compared, alike = compared + 1, alike + (count == of_linux and share > 0.95)
        print(f"| {file.stem} | {count} | {of_linux} | {share:.3f} |")
    print(f"\n{alike} of {compared} alike")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("do", choices=("fetch", "kernel"))
    parser.add_argument("--source", default=SOURCE, help="a repository with that commit")
    arguments = parser.parse_args()
    if arguments.do == "fetch":
        fetch(arguments.source)
    else:
        compare_with_the_kernel()


if __name__ == "__main__":
    main()
