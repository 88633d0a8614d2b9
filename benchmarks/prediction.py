"""How well the finger's place is predicted over the latency of the touchscreen.

    .venv/bin/python benchmarks/prediction.py             # the defaults; half a minute
    .venv/bin/python benchmarks/prediction.py --sweep     # the filters' parameters too; minutes
    .venv/bin/python benchmarks/prediction.py --recorded  # strokes of people; a minute

Synthetic fingers (`made_up_fingers`) whose true place is known are reported by a touchscreen
with noise and latency; the fingers of a live renderer are asked where they are each ms, and the
distance to the true place counts. "held" is the place of the last report: what there is without
prediction. Of recorded strokes (`recorded_strokes`) the true place is not known: a smooth path
through the reports, also later ones, counts as that.
"""

import argparse
import gc
import time
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np
from demo_setting import demo_setting
from live_cost import play
from made_up_fingers import FingerPath
from recorded_strokes import Stroke, recordings, strokes

from haptix.base.checks import Array
from haptix.base.errors import HaptixError
from haptix.play.render import LiveSettings
from haptix.play.render.fingers import PredictedFingers
from haptix.play.touch import (
    ConstantVelocityKalman,
    InteractingSinger,
    OneEuroFilter,
    PlaceFilter,
    SingerKalman,
    TouchEvent,
    TouchSettings,
)
from haptix.play.virtual_finger import TouchPanel

KINDS = ("strokes", "scribble", "zigzag", "circles")
SEEDS = tuple(range(1, 9))
SPEEDS_MM_S = (50.0, 100.0, 200.0)  # of the sweep
BLOCK_S = 0.001
SETTLES_S = 0.1  # after a finger came down
LATENCY_S = 0.03
LEAST_STROKES = 3  # of a panel
FILTERS: dict[str, PlaceFilter] = {
    "two Singers": InteractingSinger(),
    "Singer Kalman": SingerKalman(),
    "Kalman": ConstantVelocityKalman(),
    "One-Euro": OneEuroFilter(),
}


@dataclass(frozen=True)
class Setting:
    """A touchscreen, and how fast fingers move on it."""

    speed_mm_s: float = 100.0
    rate_hz: float = 100.0
    latency_s: float = LATENCY_S
    noise_mm: float = 0.1
    step_mm: float = 0.0  # of the reported place; 0 for none
    is_silent: bool = False  # about a place that is that of the report before
    missing: float = 0.0
    duration_s: float = 10.0


def errors_mm(
    kind: str, seed: int, setting: Setting, settings: TouchSettings
) -> tuple[Array, Array, float]:
    """Distance to the true place every block, held and predicted; and the share of time sliding."""
    finger = FingerPath.make(kind, seed, setting.duration_s, setting.speed_mm_s)
    events = finger.reports(
        seed + 1000, setting.rate_hz, setting.latency_s, setting.noise_mm, missing=setting.missing
    )[:-1]
    if step := setting.step_mm:
        events = [
            e._replace(x_mm=rounded(e.x_mm, step), y_mm=rounded(e.y_mm, step)) for e in events
        ]
    if setting.is_silent:
        pairs = pairwise(events)
        events = events[:1] + [new for old, new in pairs if new[2:4] != old[2:4]]
    starts = np.arange(events[0].t_s + SETTLES_S, setting.duration_s, BLOCK_S)
    touch = replace(settings, latency_s=setting.latency_s)
    return followed(events, starts, finger.place(starts), touch)


def followed(
    events: Sequence[TouchEvent], starts: Array, truth: Array, settings: TouchSettings
) -> tuple[Array, Array, float]:
    """Distance to the true places at times, held and predicted; and the share of time sliding."""
    arrivals = [event.t_s for event in events]
    held = np.empty_like(truth)
    predicted = np.empty_like(truth)
    fingers = PredictedFingers(LiveSettings(touch=settings))
    pushed = 0
    sliding = 0
    for i, start in enumerate(starts.tolist()):
        known = bisect_right(arrivals, start)
        while pushed < known:
            fingers.take(events[pushed])
            pushed += 1
        fingers.update(start)
        motion = fingers.motion(start, 1e-6, 1, 0.0, at_rest=True).motion
        predicted[i] = motion.x_mm.item(), motion.y_mm.item()
        held[i] = events[known - 1][2:4]
        sliding += fingers.touches[events[0].touch_id].at(start).is_sliding
    return (
        np.hypot(*(held - truth).T), np.hypot(*(predicted - truth).T), sliding / len(starts),
    )  # fmt: skip


def recorded_errors_mm(stroke: Stroke, settings: TouchSettings) -> tuple[Array, Array]:
    """Distance to the path of a recorded stroke every other ms, held and predicted.

    As of a panel that is `LATENCY_S` late. A report of the place before is left out, as evdev
    leaves it out.
    """
    pairs = pairwise(stroke.events)
    events = stroke.events[:1] + [new for old, new in pairs if new[2:4] != old[2:4]]
    first_s, last_s = stroke.times_s
    starts = np.arange(first_s + SETTLES_S, last_s - LATENCY_S, 2 * BLOCK_S)
    truth = stroke.path(starts + LATENCY_S)
    return followed(events, starts, truth, replace(settings, latency_s=LATENCY_S))[:2]


def recorded(settings: TouchSettings) -> None:
    """One line per panel: what it reports, and p95 of both errors over its strokes."""
    print(
        "| panel | reports | step | strokes | speed | held p95 | predicted median | p95 | ratio |"
    )
    print("|---" * 9 + "|")
    rows = []
    for file in recordings():
        try:
            of_panel = list(strokes(file))
        except HaptixError:
            continue  # it states no size, or is no touch panel
        if len(of_panel) < LEAST_STROKES:
            continue
        held, predicted = (
            np.concatenate(each)
            for each in zip(*(recorded_errors_mm(one, settings) for one in of_panel), strict=True)
        )
        interval_s = np.median(np.concatenate([moves_s(one) for one in of_panel]))
        x_mm = np.unique([round(e.x_mm, 5) for one in of_panel for e in one.events])
        speed = np.mean([mean_speed_mm_s(one) for one in of_panel])
        ratio = p95(held) / p95(predicted)
        rows.append((ratio, len(of_panel)))
        print(
            f"| {file.stem} | {1 / interval_s:.0f} Hz | {np.diff(x_mm).min():.2f} mm "
            f"| {len(of_panel)} | {speed:.0f} mm/s | {p95(held):.2f} "
            f"| {np.median(predicted):.2f} | {p95(predicted):.2f} | {ratio:.1f} |",
            flush=True,
        )
    ratios, counts = zip(*rows, strict=True)
    print(
        f"\n{len(rows)} panels, {sum(counts)} strokes: ratio {min(ratios):.1f} to "
        f"{max(ratios):.1f}, median {np.median(ratios):.1f}; 3 or more of "
        f"{sum(ratio >= 3 for ratio in ratios)}"
    )


def moves_s(stroke: Stroke) -> Array:
    """Times between reports of other places."""
    return np.array([b.t_s - a.t_s for a, b in pairwise(stroke.events) if a[2:4] != b[2:4]])


def mean_speed_mm_s(stroke: Stroke) -> float:
    first_s, last_s = stroke.times_s
    t_s = np.arange(first_s, last_s, BLOCK_S)
    return float(np.hypot(*stroke.path(t_s, 1).T).mean())


def rounded(value: float, step: float) -> float:
    return round(value / step) * step


def p95(values: Array) -> float:
    return float(np.percentile(values, 95))


def compare(name: str, settings: TouchSettings, setting: Setting, seeds: Sequence[int]) -> None:
    """One line per kind of path: p95 of both errors over all seeds, and the worst seed's ratio."""
    for kind in KINDS:
        runs = [errors_mm(kind, seed, setting, settings) for seed in seeds]
        held = p95(np.concatenate([run[0] for run in runs]))
        predicted = np.concatenate([run[1] for run in runs])
        ratios = [p95(run[0]) / p95(run[1]) for run in runs]
        print(
            f"| {name} | {kind} | {held:.2f} | {np.median(predicted):.2f} | {p95(predicted):.2f} "
            f"| {held / p95(predicted):.1f} | {min(ratios):.1f} |"
        )


def sweep(setting: Setting, seeds: Sequence[int]) -> None:
    """Every filter of a grid, the best first: the worst ratio over kinds and seeds decides."""
    for name, candidates in (
        ("Singer Kalman", singers()),
        ("Kalman", kalmans()),
        ("One-Euro", one_euros()),
    ):
        found = []
        for candidate in candidates:
            settings = TouchSettings(filter=candidate)
            ratios = [
                p95(held) / p95(predicted)
                for kind, seed, speed in product(KINDS, seeds, SPEEDS_MM_S)
                for held, predicted, _ in [
                    errors_mm(kind, seed, replace(setting, speed_mm_s=speed), settings)
                ]
            ]
            found.append((min(ratios), float(np.exp(np.mean(np.log(ratios)))), candidate))
        print(f"\n{name}: least ratio, mean ratio, parameters")
        for least, mean, candidate in sorted(found, key=lambda row: -row[0])[:8]:
            print(f"{least:6.2f} {mean:6.2f}  {candidate}")


def singers() -> Iterator[SingerKalman]:
    for still, per_speed, correlation in product(
        (50.0, 100.0, 200.0), (2.0, 3.0, 5.0, 8.0), (0.1, 0.2, 0.4)
    ):
        yield SingerKalman(still, per_speed, correlation)


def kalmans() -> Iterator[ConstantVelocityKalman]:
    for psd in (1e4, 2e4, 4e4, 1e5):
        yield ConstantVelocityKalman(psd)


def one_euros() -> Iterator[OneEuroFilter]:
    for cutoff, beta, derivative in product((2.0, 5.0, 10.0), (0.3, 1.0, 3.0), (12.0, 24.0, 36.0)):
        yield OneEuroFilter(cutoff, beta, derivative)


SURROUNDINGS = {
    "as above": Setting(),
    "60 Hz": Setting(rate_hz=60.0),
    "240 Hz": Setting(rate_hz=240.0),
    "15 ms": Setting(latency_s=0.015),
    "50 mm/s": Setting(speed_mm_s=50.0),
    "200 mm/s": Setting(speed_mm_s=200.0),
    "noise 0.02 mm": Setting(noise_mm=0.02),
    "noise 0.2 mm": Setting(noise_mm=0.2),
    "one in ten missing": Setting(missing=0.1),
    "60 Hz, steps of 1 mm, silent": Setting(
        rate_hz=60.0, noise_mm=0.0, step_mm=1.0, is_silent=True
    ),
    "60 Hz, steps of 2 mm, silent": Setting(
        rate_hz=60.0, noise_mm=0.0, step_mm=2.0, is_silent=True
    ),
}


def surroundings(settings: TouchSettings, seeds: Sequence[int]) -> None:
    """The ratio of p95 errors over all seeds, per kind of path, in other surroundings."""
    for name, setting in SURROUNDINGS.items():
        cells = []
        for kind in KINDS:
            runs = [errors_mm(kind, seed, setting, settings) for seed in seeds]
            held, predicted = (np.concatenate([run[i] for run in runs]) for i in (0, 1))
            cells.append(f"{p95(held) / p95(predicted):.1f} ({p95(predicted):.2f} mm)")
        print(f"| {name} | {' | '.join(cells)} |")


NOISES: dict[str, PlaceFilter] = {
    "one model, noise assumed": SingerKalman(noise_reports=0.0),
    "one model, noise estimated": SingerKalman(),
    "two models": InteractingSinger(),
}


def noises(seeds: Sequence[int]) -> None:
    """p95 23 ms ahead (panel 20 ms, reaction 3 ms), on several panels, for several speeds."""
    print(f"| speed | panel | filter | {' | '.join(KINDS)} | mean |")
    print("|---" * (len(KINDS) + 4) + "|")
    panels = {f"{noise} mm": Setting(noise_mm=noise) for noise in (0.1, 0.05)}
    panels["steps of 0.1 mm"] = Setting(noise_mm=0.0, step_mm=0.1)
    for speed, (panel, surrounding) in product((25.0, 50.0, 100.0), panels.items()):
        setting = replace(surrounding, latency_s=0.023, speed_mm_s=speed, duration_s=6.0)
        for name, place_filter in list(NOISES.items())[1:]:
            settings = TouchSettings(filter=place_filter)
            cells = [
                p95(np.concatenate([errors_mm(kind, s, setting, settings)[1] for s in seeds]))
                for kind in KINDS
            ]
            mean = float(np.exp(np.mean(np.log(cells))))
            row = " | ".join(f"{c:.2f}" for c in [*cells, mean])
            print(f"| {speed:.0f} mm/s | {panel} | {name} | {row} |", flush=True)


def felt() -> None:
    """Friction felt on the demo's path: 95 % of errors below, in JND, in virtual time."""
    setting, surface = demo_setting(8.0)
    panels = {
        "exact": TouchPanel(100.0, 0.02),
        "steps of 0.1 mm": TouchPanel(100.0, 0.02, 0.0, 0.0, 0.1),
        "noise of 0.1 mm": TouchPanel(100.0, 0.02, 0.1),
    }
    print(f"| panel | {' | '.join(NOISES)} |")
    print("|---" * (len(NOISES) + 1) + "|")
    for name, panel in panels.items():
        cells = [
            play(setting, surface, panel, LiveSettings(touch=TouchSettings(filter=one)))
            for one in NOISES.values()
        ]
        print(f"| {name} | {' | '.join(str(c['error p95 JND']) for c in cells)} |", flush=True)


def sliding(seeds: Sequence[int]) -> None:
    """The share of time said to slide, at rest and not; and how far off the path is at rest."""
    for name, place_filter in FILTERS.items():
        settings = TouchSettings(filter=place_filter)
        for rate in (60.0, 100.0, 240.0):
            setting = Setting(rate_hz=rate, duration_s=20.0)
            rest = [errors_mm("rest", seed, setting, settings) for seed in seeds]
            moving = [errors_mm("circles", seed, setting, settings) for seed in seeds]
            slow = [
                errors_mm("circles", seed, replace(setting, speed_mm_s=15.0), settings)
                for seed in seeds
            ]
            wander = np.sqrt(np.mean(np.concatenate([run[1] for run in rest]) ** 2))
            print(
                f"| {name} | {rate:.0f} Hz | {100 * np.mean([run[2] for run in rest]):.2f} % "
                f"| {100 * np.mean([run[2] for run in slow]):.1f} % "
                f"| {100 * np.mean([run[2] for run in moving]):.1f} % | {wander:.2f} mm |"
            )


def cost() -> None:
    """Microseconds of processor time for an event, medians of batches."""
    events = FingerPath.make("scribble", 1).reports(2)[:-1]
    for name, place_filter in FILTERS.items():
        event_us = []
        for _ in range(30):
            touch = TouchSettings(filter=place_filter, latency_s=0.03)
            fingers = PredictedFingers(LiveSettings(touch=touch))
            fingers.take(events[0])
            gc.collect()
            gc.disable()
            began = time.thread_time()
            for event in events[1:]:
                fingers.take(event)
            event_us.append((time.thread_time() - began) / (len(events) - 1) * 1e6)
            gc.enable()
        print(f"| {name} | {np.median(event_us):.1f} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sweep", action="store_true", help="try the filters' parameters")
    parser.add_argument("--noise", action="store_true", help="panels of other noise, 23 ms ahead")
    parser.add_argument("--recorded", action="store_true", help="strokes of people, see above")
    parser.add_argument("--felt", action="store_true", help="friction felt, reaction of 3 ms")
    arguments = parser.parse_args()
    if arguments.felt:
        felt()
        return
    if arguments.recorded:
        recorded(TouchSettings())
        return
    if arguments.noise:
        noises((60, 61))  # no parameter was chosen on these
        return
    base = Setting()
    if arguments.sweep:
        sweep(base, SEEDS[::3])
        return
    print("| filter | path | held p95 [mm] | predicted median | p95 | ratio | worst of 8 seeds |")
    print("|---|---|---|---|---|---|---|")
    for name, place_filter in FILTERS.items():
        compare(name, TouchSettings(filter=place_filter), base, SEEDS)
    print(f"\n| ratio (p95) | {' | '.join(KINDS)} |")
    print("|---" * (len(KINDS) + 1) + "|")
    surroundings(TouchSettings(), SEEDS[:4])
    print("\n| filter | reports | slides at rest | at 15 mm/s | at 100 mm/s | rms off at rest |")
    print("|---|---|---|---|---|---|")
    sliding(SEEDS[:4])
    print("\n| filter | an event [us] |")
    print("|---|---|")
    cost()


if __name__ == "__main__":
    main()
