"""Error felt and reaction of live rendering in real time, with stalls; see --help.

A virtual finger repeats the demo's path, a panel of 100 Hz reports it 20 ms late, and what the mock
driver played is felt at the true place. Revised streams and fixed leads run one after the other.
Stalls: 100 ms in the texture and 20 ms in the link, every second or so. Errors leave out a stall
and the 20 ms behind it.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from demo_setting import demo_setting

import haptix
from firmware_io import Device, MockDriver, MockLink
from firmware_io.links.tcp import TcpLink
from haptix.motion import Motion
from haptix.render import LiveSettings
from haptix.simulation import Setting
from haptix.texture import as_mu
from haptix.touch import TouchEvent
from haptix.virtual_finger import TouchPanel, VirtualFinger, evaluate

RENDERER_STALL_S, RENDERER_EVERY_S = 0.1, 0.97
LINK_STALL_S, LINK_EVERY_S = 0.02, 0.61
FELT_AFTER_S = 0.02
RATE_HZ = 48_000


class FixedLead(haptix.LiveRenderer):
    """Today's way: a driver that cannot revise."""

    _revises = False


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


def of_felt(
    renderer: haptix.LiveRenderer, setting: Setting, surface: Any, volts: np.ndarray,
    end_s: float, left_out: Sequence[tuple[float, float]] = (),
) -> dict[str, Any]:  # fmt: skip
    """Error of what a virtual finger feels on the setting's path, without and with some spans."""
    path = setting.path
    # In pieces: a minute at 48 kHz is long for one call.
    felt = VirtualFinger(setting.model).feel(
        volts, RATE_HZ, path.t_s, path.x_mm, path.y_mm, path.normal_force_n, 0.0
    )
    axis = surface.normal_force_n
    force = felt.normal_force_n.clip(axis.low, axis.high)
    low, high = renderer.reachable(force, felt.speed_mm_per_s)
    evaluator = setting.texture.evaluator
    motion = Motion.of(felt.x_mm, felt.y_mm, felt.t_s, *path.velocity_mm_per_s(felt.t_s), force)
    target = np.asarray(as_mu(evaluator.target, evaluator.wanted(motion), low, high))
    every = (felt.t_s > 0.3) & (felt.t_s < end_s) & (target >= low) & (target <= high)
    counts = every.copy()
    for began, ended in left_out:
        counts &= ~((felt.t_s >= began) & (felt.t_s <= ended))
    found = {"error p95 JND": round(evaluate(felt, target, counts).error_p95_jnd, 3)}
    if left_out:
        found["with stalls"] = round(evaluate(felt, target, every).error_p95_jnd, 3)
    return found


def play(
    where: Any, kind: type[haptix.LiveRenderer], settings: LiveSettings, setting: Setting,
    surface: Any, panel: TouchPanel, stalls: bool,
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
        with kind(surface, texture, device, settings=settings) as renderer:
            time.sleep(0.3)
            start_s = time.monotonic() + 0.05
            cpu_s = time.process_time()
            if stalls:
                renderer_stalls.begin()
                link_stalls.begin()
            rows = (seen.t_s, seen.x_mm, seen.y_mm, seen.normal_force_n, seen.arrival_s)
            for t, x, y, force, arrival in zip(*(r.tolist() for r in rows), strict=True):
                end.wait(max(0.0, start_s + arrival - time.monotonic()))
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
    row: dict[str, Any] = {
        **of_felt(renderer, setting, surface, volts, seen.arrival_s[-1], spans),
        "underruns": stats.underruns,
        "stalls": len(renderer_stalls.spans) + len(link_stalls.spans),
        "CPU share": round(cpu_s / seconds, 3),
        "seconds": round(seconds, 1),
    }
    if kind is not FixedLead:
        row |= {
            "revisions": stats.revisions,
            "refused": stats.refused,
            "late samples": stats.late_samples,
            "reaction p50 ms": round(1e3 * stats.reaction_p50_s, 2),
            "p99": round(1e3 * stats.reaction_p99_s, 2),
            "largest": round(1e3 * stats.reaction_max_s, 2),
        }
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--reaction-ms", type=float, default=3.0)
    parser.add_argument("--where", choices=("mock", "served", "both"), default="both")
    parser.add_argument("--revised-only", action="store_true")
    parser.add_argument("--no-stalls", action="store_true")
    parser.add_argument("--panel-noise-mm", type=float, default=0.0)
    parser.add_argument("--panel-step-mm", type=float, default=0.0)
    options = parser.parse_args()
    setting, surface = demo_setting(options.seconds)
    ways: list[tuple[str, type[haptix.LiveRenderer], LiveSettings]] = [
        (
            "revised",
            haptix.LiveRenderer,
            LiveSettings(reaction_s=options.reaction_ms / 1e3, strict=False),
        ),
    ]
    if not options.revised_only:
        ways += [
            (
                f"lead of {lead * 1e3:g} ms",
                FixedLead,
                LiveSettings(lead_s=lead, block_s=0.001, strict=False),
            )
            for lead in (0.025, 0.005)
        ]
    panel = TouchPanel(100.0, 0.02, options.panel_noise_mm, 0.0, options.panel_step_mm)
    places = {"mock": (InProcess,), "served": (Served,), "both": (InProcess, Served)}
    for where in places[options.where]:
        for name, kind, settings in ways:
            try:
                row = play(where(), kind, settings, setting, surface, panel, not options.no_stalls)
            except haptix.HaptixError as error:
                row = {"failed": str(error)}
            print(json.dumps({"where": where.__name__, "way": name, **row}), flush=True)


if __name__ == "__main__":
    main()
