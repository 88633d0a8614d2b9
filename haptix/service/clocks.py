"""The client's clock by that of the service.

The server pings, the client answers with its time. The offset of one exchange is
``client - (sent + received) / 2``, off by half the round trip at most; the line through the
quickest quarter of the last exchanges follows the drift (NTP's clock filter, RFC 5905, section 10).
"""

from __future__ import annotations

from collections import deque

from haptix.service.messages import Problem

FUTURE_S, PAST_S = 0.005, 0.5
_KEPT, _MOST_DRIFT = 64, 200e-6
_JUMP_S, _JUMPS = 0.02, 3


class ClientClock:
    """Maps the client's times to the service's.

    Attributes
    ----------
    error_s : float
        Largest error of the offset [s]: half the round trips that it was taken from.
    jumps : int
        Times that the client's clock was set anew; touches before are of another time.
    """

    def __init__(self) -> None:
        self._samples: deque[tuple[float, float, float]] = deque(maxlen=_KEPT)
        self._line: tuple[float, float, float] | None = None  # at, offset, drift
        self._odd = 0
        self.error_s = float("inf")
        self.jumps = 0

    @property
    def is_known(self) -> bool:
        """Whether an answer has come."""
        return self._line is not None

    def add(self, sent_s: float, received_s: float, client_s: float) -> bool:
        """Take an exchange; return whether the client's clock has jumped."""
        trip_s = received_s - sent_s
        middle_s = (sent_s + received_s) / 2
        offset_s = client_s - middle_s
        jumped = False
        if self._line is not None:
            at_s, line_s, drift = self._line
            error_s = abs(offset_s - line_s - drift * (middle_s - at_s))
            self._odd = self._odd + 1 if error_s > max(_JUMP_S, 3 * trip_s) else 0
            if 0 < self._odd < _JUMPS:
                return False
            if self._odd:
                self._samples.clear()
                self._odd, jumped = 0, True
                self.jumps += 1
        self._samples.append((middle_s, offset_s, trip_s))
        self._fit()
        return jumped

    def service_s(self, client_s: float) -> float:
        """Return a time of the client by the service's clock."""
        if self._line is None:
            raise Problem("clock", "the clocks are not compared yet: answer the pings first")
        at_s, offset_s, drift = self._line
        return at_s + (client_s - at_s - offset_s) / (1 + drift)

    def client_s(self, service_s: float) -> float:
        """Return a time of the service by the client's clock; nan while it is unknown."""
        if self._line is None:
            return float("nan")
        at_s, offset_s, drift = self._line
        return service_s + offset_s + drift * (service_s - at_s)

    def window(self, now_s: float) -> tuple[float, float]:
        """Return the oldest and newest stamp that `stamp` takes; nan while the clock is unknown."""
        return self.client_s(now_s - PAST_S), self.client_s(now_s + FUTURE_S + self.error_s)

    def stamp(self, client_s: float, now_s: float) -> float:
        """Return a touch's time by the service's clock.

        Raises
        ------
        Problem
            If it lies ahead of now by more than 5 ms and the clocks' uncertainty, or is older
            than half a second.
        """
        stamp_s = self.service_s(client_s)
        ahead_s = stamp_s - now_s
        if ahead_s > FUTURE_S + self.error_s:
            wrong = f"{ahead_s:.3g} s ahead"
        elif ahead_s < -PAST_S:
            wrong = f"{-ahead_s:.3g} s old"
        else:
            return stamp_s
        raise Problem(
            "clock",
            f"t_s: expected seconds of the clock that the pongs tell, got a stamp {wrong}; is "
            "it in seconds, and of the same clock?",
            "/t_s",
        )

    def _fit(self) -> None:
        best = sorted(self._samples, key=lambda sample: sample[2])
        best = best[: max(4, len(best) // 4)]
        self.error_s = sum(trip for _, _, trip in best) / len(best) / 2
        at_s = sum(time for time, _, _ in best) / len(best)
        offset_s = sum(offset for _, offset, _ in best) / len(best)
        spread = sum((time - at_s) ** 2 for time, _, _ in best)
        drift = 0.0
        if spread > 1.0:  # a shorter stretch shows jitter, not drift
            drift = sum((time - at_s) * (offset - offset_s) for time, offset, _ in best) / spread
            drift = min(max(drift, -_MOST_DRIFT), _MOST_DRIFT)
        self._line = (at_s, offset_s, drift)
