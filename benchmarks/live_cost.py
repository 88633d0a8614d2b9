"""Processor time and accuracy of a revised stream in virtual time: what other programs do is moot.

    .venv/bin/python benchmarks/live_cost.py                       # one finger on a photograph
    .venv/bin/python benchmarks/live_cost.py --profile             # where it goes
    .venv/bin/python benchmarks/live_cost.py --panel-step-mm 0.1
    .venv/bin/python benchmarks/live_cost.py --sense --times 3     # without and with sensing

The app, the renderer and the feeder work as in real time, on a clock that jumps from one event to
the next: the demo's path, a panel of 100 Hz that is 20 ms late, reactions of 3 ms. The mock
driver's own work is measured apart. Times are those of the processor, for each second of play.
"""

from __future__ import annotations

import argparse
import cProfile
import json
import os
import pstats
import time
from collections import Counter, defaultdict
from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import numpy as np
from demo_setting import demo_setting

import haptix
from firmware_io import Device, MockConverter, MockDriver, MockLink
from haptix.play.render import LiveSettings
from haptix.play.sensing import ContactCurrent, FingerObserver
from haptix.play.simulation import Played, Setting, evaluate_live
from haptix.play.touch import TouchEvent
from haptix.play.virtual_finger import LiveCurrent, TouchPanel, VirtualCurrent

RATE_HZ = 48_000
CARRIER_HZ = 4000.0
WAKES_S = 1e-4  # after a touch, as a quiet machine's threads do


class Clock:
    """Stands until it is moved."""

    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


class Meter:
    """Adds up processor time, by name; what is measured within counts once."""

    def __init__(self) -> None:
        self.spent: defaultdict[str, float] = defaultdict(float)
        self.calls: Counter[str] = Counter()
        self._within = [0.0]

    def of(self, name: str, call: Any) -> Any:
        def measured(*given: Any, **named: Any) -> Any:
            self._within.append(0.0)
            began = time.thread_time()
            try:
                return call(*given, **named)
            finally:
                passed = time.thread_time() - began
                self.spent[name] += passed - self._within.pop()
                self.calls[name] += 1
                self._within[-1] += passed

        return measured


def mock(clock: Clock) -> MockLink:
    """A mock that carries what it is sent at once."""
    return MockLink(MockDriver(pace="real", clock=clock, kept_s=600.0), sleep=clock.sleep)


def play(
    setting: Setting, surface: Any, panel: TouchPanel, settings: LiveSettings, profile: Any = None,
    make_link: Callable[[Clock], MockLink] = mock, observer: FingerObserver | None = None,
    **opening: Any,
) -> dict[str, Any]:  # fmt: skip
    """Play a path; return processor time of each part, counts, and the error felt.

    With an observer it senses: the mock's converter measures the finger of the setting.
    """
    clock, meter = Clock(), Meter()
    link = make_link(clock)
    driver = link.driver
    device = Device(link, clock=clock, **opening)
    live = None
    if observer is not None:
        live = LiveCurrent.on(device, VirtualCurrent(setting.model, CARRIER_HZ))
    link.send = meter.of("mock", link.send)  # type: ignore[method-assign]
    link.receive = meter.of("mock", link.receive)  # type: ignore[method-assign]
    seen = panel.read(setting.path)
    sense = False if observer is None else observer
    with haptix.LiveRenderer(
        surface, setting.texture, device, settings=settings, sense=sense
    ) as renderer:
        playback = renderer._running()
        source = renderer._source
        source.window = meter.of("renderer", source.window)  # type: ignore[method-assign]
        event, step = meter.of("app", renderer.event), meter.of("feeder", playback.step)
        start_s = clock() + 0.3
        due_s = clock()
        with profile or nullcontext():
            rows = (seen.t_s, seen.x_mm, seen.y_mm, seen.normal_force_n, seen.arrival_s)
            for t, x, y, force, arrival in zip(*(row.tolist() for row in rows), strict=True):
                while due_s < start_s + arrival:
                    clock.now_s = max(due_s, clock.now_s)
                    due_s = clock() + max(step(), 1e-5)
                clock.now_s = max(start_s + arrival, clock.now_s)
                event(TouchEvent(start_s + t, 0, x, y, "move", force))
                if live is not None:
                    live.touch(start_s + t, x, y, force)
                due_s = clock() + WAKES_S
        seconds = clock() - start_s
        reactions = np.array(renderer.stats.reactions_s) * 1e3
    device.close()
    volts = driver.output_v[round((start_s - driver._began_s) * RATE_HZ) :]
    played = Played(setting, renderer, device, volts, 0.0)
    p50, p99 = np.percentile(reactions, (50, 99)).round(2).tolist()
    parts = {name: meter.spent[name] / seconds for name in ("app", "renderer", "feeder", "mock")}
    ours = sum(parts.values()) - parts["mock"]
    return {
        "core share": round(ours, 4),
        **{f"{name} ms/s": round(1e3 * one, 1) for name, one in parts.items()},
        "windows/s": round(meter.calls["renderer"] / seconds, 1),
        "steps/s": round(meter.calls["feeder"] / seconds, 1),
        "revisions": renderer.stats.revisions,
        "refused": renderer.stats.refused,
        "late samples": renderer.stats.late_samples,
        "underruns": renderer.stats.underruns,
        "reaction p50 ms": p50,
        "p99": p99,
        "largest": round(float(reactions.max()), 2),
        "error p95 JND": round(evaluate_live(played).error_p95_jnd, 3),
    }


def measuring(clock: Clock) -> MockLink:
    """A mock whose driver has a sensor."""
    driver = MockDriver(pace="real", clock=clock, kept_s=600.0, converter=MockConverter())
    return MockLink(driver, sleep=clock.sleep)


def compare(setting: Setting, surface: Any, panel: TouchPanel, times: int) -> None:
    """Play in turn without and with sensing, and print how much of a core each takes."""
    contact = ContactCurrent.of_surface(surface, CARRIER_HZ)
    shares: dict[bool, list[float]] = {False: [], True: []}
    for senses in (False, True) * times:
        observer = FingerObserver(contact) if senses else None
        row = play(
            setting, surface, panel, LiveSettings(), None, measuring if senses else mock, observer,
            mode="envelope",
        )  # fmt: skip
        shares[senses].append(row["core share"])
        print(json.dumps({"sensing": senses, **row}), flush=True)
    ratio = np.median(shares[True]) / np.median(shares[False])
    print(f"with sensing {ratio:.2f} times the processor time; load {os.getloadavg()[0]:.1f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--times", type=int, default=1, help="repeat, since clocks of cores vary")
    parser.add_argument("--panel-noise-mm", type=float, default=0.0)
    parser.add_argument("--panel-step-mm", type=float, default=0.0)
    parser.add_argument("--profile", action="store_true")
    parser.add_argument("--sense", action="store_true", help="compare with and without")
    options = parser.parse_args()
    setting, surface = demo_setting(options.seconds)
    panel = TouchPanel(100.0, 0.02, options.panel_noise_mm, 0.0, options.panel_step_mm)
    if options.sense:
        compare(setting, surface, panel, options.times)
        return
    profile = cProfile.Profile() if options.profile else None
    for _ in range(options.times):
        print(json.dumps(play(setting, surface, panel, LiveSettings(), profile)), flush=True)
    if profile is not None:
        pstats.Stats(profile).sort_stats("tottime").print_stats(45)


if __name__ == "__main__":
    main()
