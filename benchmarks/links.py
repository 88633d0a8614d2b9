"""Reactions that slow links allow: lines and reports at their own pace, in virtual time.

    .venv/bin/python benchmarks/links.py

The stream of live_cost.py on links that carry bytes, or reports, one after the other. A host takes
0.1 ms to wake after a touch and 0.5 ms to render a window; what an operating system adds is not in
it. So these are the reactions that a link allows, not those that a machine holds.
"""

from __future__ import annotations

import argparse
import json
from collections import deque
from collections.abc import Callable
from typing import Any

from demo_setting import demo_setting
from live_cost import Clock, play

from firmware_io import MockDriver, MockLink
from firmware_io.protocol import REPORT_BYTES, to_reports
from haptix.play.render import LiveSettings
from haptix.play.simulation import Setting
from haptix.play.virtual_finger import TouchPanel

PIECE_BYTES = 32  # that arrive together
BUFFER_BYTES = 4096  # of a serial port: a host that writes more waits
TICK_S = 5e-4  # in which the driver's answers leave it
WORK_S = 5e-4  # of the host, for a window


class PacedLink(MockLink):
    """Carries bytes, or reports, at a rate each way; the host waits for reports to be taken."""

    def __init__(
        self, host: Clock, bytes_per_s: float | None = None, reports_per_s: float | None = None
    ) -> None:
        self._device_clock = Clock()
        driver = MockDriver(pace="real", clock=self._device_clock, kept_s=600.0)
        super().__init__(driver, None if reports_per_s is None else REPORT_BYTES, host.sleep)
        self._host = host
        self.bytes_per_s = bytes_per_s
        self._report_s = None if reports_per_s is None else 1 / reports_per_s
        self._outward: deque[tuple[float, bytes]] = deque()
        self._inward: deque[tuple[float, bytes]] = deque()
        self._out_free_s = self._in_free_s = self._tick_s = host()

    def send(self, data: bytes) -> None:
        host = self._host
        if self._report_s is not None:
            for report in to_reports(data, REPORT_BYTES):
                self._out_free_s = max(self._out_free_s, host()) + self._report_s
                self._outward.append((self._out_free_s, report))
            host.now_s = max(host(), self._out_free_s)
        else:
            assert self.bytes_per_s is not None
            for at in range(0, len(data), PIECE_BYTES):
                piece = data[at : at + PIECE_BYTES]
                took_s = len(piece) / self.bytes_per_s
                self._out_free_s = max(self._out_free_s, host()) + took_s
                self._outward.append((self._out_free_s, piece))
            host.now_s = max(host(), self._out_free_s - BUFFER_BYTES / self.bytes_per_s)
        self._pass_time()

    def receive(self, timeout_s: float = 0.0) -> bytes:
        end_s = self._host() + timeout_s
        while True:
            self._pass_time()
            found = b""
            while self._inward and self._inward[0][0] <= self._host():
                found += self._inward.popleft()[1]
            if found or self._host() >= end_s:
                return found
            self._host.sleep(1e-4)

    def _pass_time(self) -> None:
        """Let the driver live up to now."""
        now_s = self._host()
        while True:
            arrives_s = self._outward[0][0] if self._outward else now_s
            at_s = min(arrives_s, self._tick_s, now_s)
            if at_s == now_s and not (self._outward and arrives_s <= now_s):
                break
            self._device_clock.now_s = at_s
            if self._outward and arrives_s <= at_s:
                data = self._outward.popleft()[1]
                if self._report_s is None:
                    self.driver.receive(data)
                else:
                    self.driver.receive_report(data)
            if self._tick_s <= at_s:
                self._tick_s += TICK_S
            self._answer(at_s)
        self._device_clock.now_s = now_s

    def _answer(self, at_s: float) -> None:
        if self._report_s is None:
            assert self.bytes_per_s is not None
            if data := self.driver.transmit():
                self._in_free_s = max(self._in_free_s, at_s) + len(data) / self.bytes_per_s
                self._inward.append((self._in_free_s, data))
            return
        while report := self.driver.transmit_report():
            self._in_free_s = max(self._in_free_s, at_s) + self._report_s
            self._inward.append((self._in_free_s, report[2 : 2 + (report[1] & 0x7F)]))


class Working:
    """A texture whose evaluator takes the host's time."""

    def __init__(self, texture: Any, clock: Callable[[], Clock]) -> None:
        self._evaluator, self._clock = texture.evaluator, clock

    @property
    def evaluator(self) -> Any:
        return self

    def __getattr__(self, name: str) -> Any:
        return getattr(self._evaluator, name)

    def wanted(self, motion: Any) -> Any:
        self._clock().sleep(WORK_S)
        return self._evaluator.wanted(motion)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--only", default="", help="links whose name has this")
    options = parser.parse_args()
    setting, surface = demo_setting(options.seconds)
    panel = TouchPanel(100.0, 0.02)
    clocks: list[Clock] = []

    def paced(**pace: float) -> Callable[[Clock], MockLink]:
        def make(clock: Clock) -> MockLink:
            clocks.append(clock)
            return PacedLink(clock, **pace)

        return make

    envelope: dict[str, Any] = {"mode": "envelope"}
    links: dict[str, tuple[Callable[[Clock], MockLink], dict[str, Any]]] = {
        "serial, 2 Mbaud, waveform": (paced(bytes_per_s=2e5), {}),
        "serial, 3 Mbaud, waveform": (paced(bytes_per_s=3e5), {}),
        "serial, 2 Mbaud, envelope": (
            paced(bytes_per_s=2e5), envelope | {"sample_rate_hz": 16_000},
        ),
        "serial, 921600 baud, envelope": (
            paced(bytes_per_s=92_160.0), envelope | {"sample_rate_hz": 16_000},
        ),
        "hid, 8 kHz": (paced(reports_per_s=1000.0), envelope | {"sample_rate_hz": 8000}),
        "hid, 16 kHz": (paced(reports_per_s=1000.0), envelope),
    }  # fmt: skip
    for name, (link, opening) in links.items():
        if options.only not in name:
            continue
        working = Working(setting.texture, lambda: clocks[-1])
        there = Setting(setting.model, working, setting.path)
        row = play(there, surface, panel, LiveSettings(), None, link, **opening)
        shown = ("reaction p50 ms", "p99", "largest", "error p95 JND", "windows/s", "revisions")
        counts = ("refused", "late samples", "underruns")
        print(json.dumps({"link": name} | {key: row.get(key) for key in (*shown, *counts)}))


if __name__ == "__main__":
    main()
