"""The proof test of a driver: its own tests, and each limit tripped once, at 0 V."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from firmware_io.clock import HOST_CLOCK
from firmware_io.link import Link
from firmware_io.protocol import (
    Arm,
    CapabilitiesReport,
    FaultCode,
    FaultReport,
    Frame,
    FrameParser,
    Hello,
    Setup,
    StreamMode,
    StreamSamples,
    encode,
)

#: Words for the cause of the driver's last reset, by the number in CAPABILITIES.
RESETS = (
    "not told",
    "power, and its watchdog has been seen to reset it",
    "its watchdog",
    "unknown",
)
_ANSWER_S = 0.5


class Proof(NamedTuple):
    """One statement of a driver, whether it held, and the measured value."""

    what: str
    holds: bool
    seen: str


def proof_test(link: Link, clock: Callable[[], float] = HOST_CLOCK) -> list[Proof]:
    """Trip each limit of a driver that can be tripped while its output stays at 0 V.

    The driver accepts zeros only; every other sample breaks a limit and is never played.

    Parameters
    ----------
    link : Link
        Link to a driver that nobody else uses.
    clock : callable
        Clock of the host, in seconds.

    Returns
    -------
    list of Proof
        The driver's own tests at power-up, and each limit.
    """
    session = _Session(link, clock)
    about = session.begin()
    if about is None:
        return [Proof("an answer to HELLO", False, f"none in {_ANSWER_S + link.wakes_s} s")]
    whole = (about.oldest_version, about.serial, about.output_rate_hz)
    proofs = [
        Proof("an answer to HELLO", True, "version {}, serial {!r}, {} Hz".format(*whole)),
        Proof(
            "its own tests at power-up: memory, program, limits",
            about.has_tested_itself,
            "passed" if about.has_tested_itself else "it does not say so",
        ),
        Proof("what reset it last", about.reset_cause != 2, RESETS[about.reset_cause]),
    ]
    codes = np.zeros(4, np.int16)
    high, steep = codes.copy(), codes.copy()
    high[0] = -32768
    # At the lowest slew that the driver takes with its ceiling, one step to that is too steep.
    steep[0] = max(1, _ceiling_mv(about) * 32767 // about.full_scale_mv)
    cases = (
        ("a sample above the ceiling", FaultCode.CEILING, (high, 0, 0, b"")),
        ("a step above the slew", FaultCode.SLEW, (steep, 0, 0, b"")),
        ("a frame that was lost", FaultCode.SEQUENCE, (codes, 1, 0, b"")),
        ("samples that were lost", FaultCode.SAMPLE_INDEX, (codes, 0, 4, b"")),
        ("a damaged frame", FaultCode.DAMAGED, (codes, 0, 0, b"\1")),
        ("silence of the host", FaultCode.STARVED, (codes, 0, 0, b"")),
    )
    for what, due, (samples, skipped, gap, damage) in cases:
        seen = session.provoke(about, samples, skipped, gap, damage)
        proofs.append(Proof(f"{what} ends the output", due.name in seen, seen))
    session.begin()
    return proofs


def _ceiling_mv(about: CapabilitiesReport) -> int:
    """Highest ceiling of a session: an amplifier may reach less than the driver's own ceiling."""
    return min(about.ceiling_mv, about.full_scale_mv)


class _Session:
    def __init__(self, link: Link, clock: Callable[[], float]) -> None:
        self._link, self._clock = link, clock
        self._parser = FrameParser()
        self._sequence = 0

    def _say(self, message: object, damage: bytes = b"") -> None:
        data = bytearray(encode(Frame(message, self._sequence)))  # type: ignore[arg-type]
        if damage:
            data[-1] ^= damage[0]
        self._link.send(bytes(data))
        self._sequence = (self._sequence + 1) % 2**16

    def _await(self, kind: type, seconds: float = _ANSWER_S) -> object | None:
        end_s = self._clock() + seconds
        while True:
            for item in self._parser.feed(self._link.receive(max(0.0, end_s - self._clock()))):
                message = getattr(item, "message", None)
                if isinstance(message, kind):
                    return message
            if self._clock() >= end_s:
                return None

    def begin(self) -> CapabilitiesReport | None:
        about = None
        for _ in range(1 + round(self._link.wakes_s / _ANSWER_S)):
            self._say(Hello())
            if (about := self._await(CapabilitiesReport)) is not None:
                break
        assert about is None or isinstance(about, CapabilitiesReport)
        return about

    def provoke(
        self, about: CapabilitiesReport, samples: np.ndarray, skipped: int, gap: int, damage: bytes
    ) -> str:
        """Arm, send samples, and return the driver's answer in words."""
        self.begin()
        rate = about.rates[0]
        mode = min(rate.modes)
        ticks = (about.output_rate_hz * 5 + 999) // 1000
        step = -(-(_ceiling_mv(about) * 32767 // about.full_scale_mv) // ticks)
        lowest = -(-step * about.output_rate_hz * about.full_scale_mv // 32_767_000)
        carrier = 1_000_000 if mode is StreamMode.ENVELOPE else 0
        limits = (about.full_scale_mv, _ceiling_mv(about), max(1, lowest))
        self._say(Setup(mode, about.max_watchdog_ms, rate.sample_rate_hz, *limits, carrier, 0, 0))
        self._say(Arm())
        self._sequence += skipped
        self._say(StreamSamples(gap, samples, mode), damage)
        fault = self._await(FaultReport, _ANSWER_S + about.max_watchdog_ms / 1e3)
        if not isinstance(fault, FaultReport):
            return "no FAULT"
        self._say(Hello())
        state = self._await(CapabilitiesReport)
        return f"{fault.code.name}, {'answers' if state else 'then silent'}"
