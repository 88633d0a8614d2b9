"""Error felt and reaction of live rendering in real time, with stalls; see --help.

A virtual finger repeats the demo's path, a panel of 100 Hz reports it 20 ms late, and what the mock
driver played is felt at the true place. Stalls: 100 ms in the texture and 20 ms in the link, every
second or so. Errors leave out a stall and the 20 ms behind it. Each is compared with that of the
same stroke in steps, as `haptix render` plays it ("of steps", which must be within 10 % of 1
without stalls), and in steps with touches as late as this machine gave them ("of steps as late").

With --interpreter a thread holds the interpreter for 100 ms every second or so instead, and another
process reports the finger: in turns to the interpreter and to a thread of its own, over TCP.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import os
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from demo_setting import demo_setting

import haptix
from firmware_io import Device, MockDriver, MockLink
from firmware_io.links.tcp import TcpLink
from haptix.feel.motion import Trajectory
from haptix.play.render import LiveSettings
from haptix.play.simulation import Played, Setting, evaluate_live
from haptix.play.simulation.run import play_live
from haptix.play.touch import TouchEvent
from haptix.play.virtual_finger import SensedTouch, TouchPanel

RENDERER_STALL_S, RENDERER_EVERY_S = 0.1, 0.97
LINK_STALL_S, LINK_EVERY_S = 0.02, 0.61
FELT_AFTER_S = 0.02
RATE_HZ = 48_000


class Stalls:
    """When something stands still, by the host's clock."""

    def __init__(self, length_s: float, every_s: float) -> None:
        self.length_s, self.every_s = length_s, every_s
        self.spans: list[tuple[float, float]] = []
        self._next_s = np.inf

    def begin(self) -> None:
        self._next_s = time.monotonic() + self.every_s

    def maybe(self) -> None:
        now_s = time.monotonic()
        if now_s >= self._next_s:
            time.sleep(self.length_s)
            self._next_s = now_s + self.every_s
            self.spans.append((now_s, time.monotonic()))


class StallingTexture:
    """A texture whose evaluator stands still now and then."""

    def __init__(self, texture: Any, stalls: Stalls) -> None:
        self._evaluator, self._stalls = texture.evaluator, stalls

    @property
    def evaluator(self) -> Any:
        return self

    def __getattr__(self, name: str) -> Any:
        return getattr(self._evaluator, name)

    def wanted(self, motion: Any) -> Any:
        self._stalls.maybe()
        return self._evaluator.wanted(motion)


def stalling(link: Any, stalls: Stalls) -> Any:
    send = link.send

    def late(data: bytes) -> None:
        stalls.maybe()
        send(data)

    link.send = late
    return link


class InProcess:
    """A mock of this process."""

    def __enter__(self) -> InProcess:
        driver = MockDriver(pace="real", clock=time.monotonic, kept_s=600.0)
        self.driver, self.link = driver, MockLink(driver)
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def output(self, device: Device) -> tuple[np.ndarray, float]:
        """Volts, and when the first was played."""
        device.close()
        return self.driver.output_v, self.driver._began_s


class Served:
    """A mock of another process, over TCP on this machine."""

    def __enter__(self) -> Served:
        self._folder = tempfile.TemporaryDirectory()
        self._record = Path(self._folder.name) / "record.npy"
        command = [sys.executable, "-m", "firmware_io.serve", "--port", "0", "--record"]
        self._process = subprocess.Popen(
            [*command, str(self._record)], stdout=subprocess.PIPE, text=True
        )
        assert self._process.stdout is not None
        _, host, port = self._process.stdout.readline().strip().split(":")
        self.link = TcpLink(host, int(port))
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        self._folder.cleanup()

    def output(self, device: Device) -> tuple[np.ndarray, float]:
        client = device._stream.client
        began = []
        for _ in range(30):  # the fastest answer says when the driver's clock began
            sent_s = time.monotonic()
            status = client.synchronise()
            began.append((time.monotonic() - sent_s, sent_s - status.clock_ticks / RATE_HZ))
        device.close()
        self._process.terminate()
        self._process.wait()
        return np.load(self._record), min(began)[1]


class HeldInterpreter:
    """A thread that lets no other one have the interpreter now and then."""

    def __init__(self) -> None:
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._hold)
        self.spans: list[tuple[float, float]] = []

    def __enter__(self) -> HeldInterpreter:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()

    def _hold(self) -> None:
        hold = ctypes.PyDLL(None).usleep
        while not self._end.wait(RENDERER_EVERY_S):
            now_s = time.monotonic()
            hold(int(1e6 * RENDERER_STALL_S))
            self.spans.append((now_s, time.monotonic()))


_REPORT = struct.Struct("=iiiiddddd")
_FEEDER = """
import os, sys, time, numpy as np
to, start_s, rows = int(sys.argv[1]), float(sys.argv[2]), np.load(sys.argv[3])
from firmware_io.own_thread import finger_report
for t, x, y, force, arrival in rows.tolist():
    time.sleep(max(0.0, start_s + arrival - time.monotonic()))
    os.write(to, finger_report(0, start_s + t, x, y, force))
"""


def feed(to: int, start_s: float, seen: SensedTouch) -> subprocess.Popen[bytes]:
    """Let another process report a finger as its panel does."""
    rows = np.stack([seen.t_s, seen.x_mm, seen.y_mm, seen.normal_force_n, seen.arrival_s], axis=1)
    with tempfile.NamedTemporaryFile(suffix=".npy", delete=False) as file:
        np.save(file, rows)
    command = [sys.executable, "-c", _FEEDER, str(to), str(start_s), file.name]
    return subprocess.Popen(command, pass_fds=[to])


def play_held(
    settings: LiveSettings, setting: Setting, surface: Any, panel: TouchPanel
) -> dict[str, Any]:
    """Play while a thread holds the interpreter."""
    seen = panel.read(setting.path)
    with Served() as place:
        device = Device(place.link)
        with haptix.LiveRenderer(surface, setting.texture, device, settings=settings) as renderer:
            plays_by = renderer.plays_by
            came, to = os.pipe()

            def follow() -> None:
                while data := os.read(came, _REPORT.size):
                    _, touch_id, _, _, _, t_s, x, y, force = _REPORT.unpack(data)
                    renderer.event(TouchEvent(t_s, touch_id, x, y, "move", force))

            follower = threading.Thread(target=follow)
            follower.start()
            start_s = time.monotonic() + 1.0
            feeder = feed(renderer.reports or to, start_s, seen)
            os.close(to)
            time.sleep(0.9)
            cpu_s = time.process_time()
            with HeldInterpreter() as held:
                feeder.wait()
            cpu_s = time.process_time() - cpu_s
            follower.join()
            os.close(came)
        volts, began_s = place.output(device)
    stats = renderer.stats
    volts = volts[round((start_s - began_s) * RATE_HZ) :]
    played = Played(setting, renderer, device, volts, 0.0)
    return {
        "plays by": plays_by,
        "error p95 JND": round(evaluate_live(played).error_p95_jnd, 3),
        "underruns": stats.underruns,
        "stalls": len(held.spans),
        "CPU share": round(cpu_s / setting.path.duration_s, 3),
        "revisions": stats.revisions,
        "refused": stats.refused,
        "reaction p50 ms": round(1e3 * stats.reaction_p50_s, 2),
        "p99": round(1e3 * stats.reaction_p99_s, 2),
        "largest": round(1e3 * stats.reaction_max_s, 2),
        "longest stall ms": round(1e3 * stats.longest_stall_s, 2),
    }


@dataclass(frozen=True)
class PanelAsRead(TouchPanel):
    """A panel whose reports arrive when they did."""

    seen: SensedTouch | None = None

    def read(self, path: Trajectory, seed: int = 0) -> SensedTouch:
        assert self.seen is not None
        return self.seen


Steps = Callable[[TouchPanel, list[tuple[float, float]]], float]
"""Return the 95 % error in steps, but for spans that are left out."""


def play(
    where: Any, settings: LiveSettings, setting: Setting, surface: Any, panel: TouchPanel,
    stalls: bool, in_steps: Steps,
) -> dict[str, Any]:  # fmt: skip
    renderer_stalls = Stalls(RENDERER_STALL_S, RENDERER_EVERY_S)
    link_stalls = Stalls(LINK_STALL_S, LINK_EVERY_S)
    seen = panel.read(setting.path)
    end = threading.Event()
    with where as place:
        link = stalling(place.link, link_stalls)
        device = Device(link)
        texture = StallingTexture(setting.texture, renderer_stalls)
        cpu_s = 0.0
        with haptix.LiveRenderer(surface, texture, device, settings=settings) as renderer:
            time.sleep(0.3)
            start_s = time.monotonic() + 0.05
            cpu_s = time.process_time()
            if stalls:
                renderer_stalls.begin()
                link_stalls.begin()
            rows = (seen.t_s, seen.x_mm, seen.y_mm, seen.normal_force_n, seen.arrival_s)
            came_s = []
            for t, x, y, force, arrival in zip(*(r.tolist() for r in rows), strict=True):
                end.wait(max(0.0, start_s + arrival - time.monotonic()))
                came_s.append(time.monotonic() - start_s)
                renderer.event(TouchEvent(start_s + t, 0, x, y, "move", force))
            cpu_s = time.process_time() - cpu_s
            seconds = time.monotonic() - start_s
        volts, began_s = place.output(device)
    stats = renderer.stats
    volts = volts[round((start_s - began_s) * RATE_HZ) :]
    spans = [
        (began - start_s, ended - start_s + FELT_AFTER_S)
        for began, ended in renderer_stalls.spans + link_stalls.spans
    ]
    played = Played(setting, renderer, device, volts, 0.0)
    error = evaluate_live(played, spans).error_p95_jnd
    steps = in_steps(panel, spans)
    as_late = in_steps(PanelAsRead(seen=replace(seen, arrival_s=np.array(came_s))), spans)
    row: dict[str, Any] = {
        "error p95 JND": round(error, 3),
        "in steps": round(steps, 3),
        "of steps": round(error / steps, 3),
        "of steps as late": round(error / as_late, 3),
    }
    if spans:
        row["with stalls"] = round(evaluate_live(played).error_p95_jnd, 3)
    return row | {
        "underruns": stats.underruns,
        "stalls": len(spans),
        "CPU share": round(cpu_s / seconds, 3),
        "seconds": round(seconds, 1),
        "revisions": stats.revisions,
        "refused": stats.refused,
        "late samples": stats.late_samples,
        "reaction p50 ms": round(1e3 * stats.reaction_p50_s, 2),
        "p99": round(1e3 * stats.reaction_p99_s, 2),
        "largest": round(1e3 * stats.reaction_max_s, 2),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--reaction-ms", type=float, default=3.0)
    parser.add_argument("--where", choices=("mock", "served", "both"), default="both")
    parser.add_argument("--no-stalls", action="store_true")
    parser.add_argument("--panel-noise-mm", type=float, default=0.0)
    parser.add_argument("--panel-step-mm", type=float, default=0.0)
    parser.add_argument("--interpreter", action="store_true")
    parser.add_argument("--turns", type=int, default=1)
    options = parser.parse_args()
    setting, surface = demo_setting(options.seconds)
    settings = LiveSettings(reaction_s=options.reaction_ms / 1e3, strict=False)
    panel = TouchPanel(100.0, 0.02, options.panel_noise_mm, 0.0, options.panel_step_mm)

    if options.interpreter:
        for _ in range(options.turns):
            for own in (False, True):
                row = play_held(replace(settings, own_thread=own), setting, surface, panel)
                print(json.dumps(row), flush=True)
        return

    def in_steps(panel: TouchPanel, spans: list[tuple[float, float]]) -> float:
        played = play_live(setting, surface, panel, settings, "mock:")
        return evaluate_live(played, spans).error_p95_jnd

    places = {"mock": (InProcess,), "served": (Served,), "both": (InProcess, Served)}
    for where in places[options.where]:
        try:
            stalls = not options.no_stalls
            row = play(where(), settings, setting, surface, panel, stalls, in_steps)
        except haptix.HaptixError as error:
            row = {"failed": str(error)}
        print(json.dumps({"where": where.__name__, **row}), flush=True)


if __name__ == "__main__":
    main()
