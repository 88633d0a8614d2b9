"""Limits how often touches reach the renderer: rendering takes at most half of the time."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable

from haptix.play.touch.events import TouchEvent

_TIMED_PASSES, _REST, MOST_INTERVAL_S = 8, 16, 0.03


class TouchGate:
    """Passes touches on at once, but moves not more often than every interval.

    Of the moves that wait for it, one in each interval of stamps is kept of each finger: the
    newest. So ten fingers at 1 kHz do not keep the renderer from playing. A down or an up passes at
    once, with the moves that wait before it.

    Parameters
    ----------
    take : callable
        Takes touches in their order, never from two threads at once.
    interval_s : callable
        Returns the interval [s]. Sixteen times what `take` takes is added, up to 30 ms: so ten
        fingers are rendered anew each 10 ms or so, and one as often as it can be.
    """

    def __init__(
        self, take: Callable[[list[TouchEvent]], None], interval_s: Callable[[], float]
    ) -> None:
        self._take, self._render_s = take, interval_s
        self._pass_times_s: deque[float] = deque([0.0], maxlen=_TIMED_PASSES)
        self._waiting: dict[int, list[TouchEvent]] = {}  # by finger
        self._newest_s: dict[int, float] = {}  # stamps that were passed on
        self._passed_s = float("-inf")
        self._has_more = threading.Condition(threading.RLock())
        threading.Thread(target=self._passes, name="haptix touch gate", daemon=True).start()

    def put(self, touches: list[TouchEvent]) -> None:
        """Take touches, and pass them on now or soon."""
        with self._has_more:
            interval_s, waited = self._interval_s(), bool(self._waiting)
            for touch in touches:
                self._keep(touch, interval_s)
            is_due = time.monotonic() - self._passed_s >= interval_s
            if is_due or any(touch.kind != "move" for touch in touches):
                self._pass()
            elif not waited:  # otherwise the thread sleeps until the interval is over
                self._has_more.notify()

    def forget(self) -> None:
        """Drop the waiting touches."""
        with self._has_more:
            self._waiting.clear()

    def _interval_s(self) -> float:
        # The quickest: nothing else held it up.
        return min(self._render_s() + _REST * min(self._pass_times_s), MOST_INTERVAL_S)

    def _keep(self, touch: TouchEvent, interval_s: float) -> None:
        waiting = self._waiting.setdefault(touch.touch_id, [])
        if waiting and touch.kind == waiting[-1].kind == "move":
            last_s = waiting[-1].t_s
            before_s = waiting[-2].t_s if len(waiting) > 1 else self._newest_s.get(touch.touch_id)
            if before_s is not None and 0 <= last_s - before_s < interval_s:
                waiting[-1] = touch  # the one it replaces was close to the one before
                return
        waiting.append(touch)

    def _pass(self) -> None:
        waiting, self._waiting = self._waiting, {}
        self._passed_s = began_s = time.monotonic()
        for touch_id, touches in waiting.items():
            if touches[-1].kind == "up":
                self._newest_s.pop(touch_id, None)
            else:
                self._newest_s[touch_id] = touches[-1].t_s
        if waiting:
            self._take([touch for touches in waiting.values() for touch in touches])
            self._pass_times_s.append(time.monotonic() - began_s)

    def _passes(self) -> None:
        with self._has_more:
            while True:
                while not self._waiting:
                    self._has_more.wait()
                left_s = self._passed_s + self._interval_s() - time.monotonic()
                if left_s > 0:
                    self._has_more.wait(left_s)
                else:
                    self._pass()
