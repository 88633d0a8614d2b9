"""How a client reports fingers, with and without await."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from typing import Generic, Literal, TypeVar

from haptix.service import messages as m

TouchKind = Literal["down", "move", "up"]
Sent = TypeVar("Sent", covariant=True)


class ReportsTouches(ABC, Generic[Sent]):
    """Touches in millimetres; `Sent` is what a client returns for a batch."""

    @abstractmethod
    def touches(self, touches: list[m.TouchMessage]) -> Sent:
        """Report many touches in one batch of bytes."""

    def touch(
        self,
        x_mm: float,
        y_mm: float,
        normal_force_n: float | None = None,
        touch_id: int = 0,
        kind: TouchKind = "move",
        t_s: float | None = None,
    ) -> Sent:
        """Report a touch, at `now_s` unless `t_s` says when."""
        stamp_s = self.now_s() if t_s is None else t_s
        one = m.TouchMessage(
            t_s=stamp_s,
            touch_id=touch_id,
            kind=kind,
            x_mm=x_mm,
            y_mm=y_mm,
            normal_force_n=normal_force_n,
        )
        return self.touches([one])

    def lift(self, touch_id: int = 0, t_s: float | None = None) -> Sent:
        """Take a finger off."""
        return self.touch(0.0, 0.0, touch_id=touch_id, kind="up", t_s=t_s)

    @staticmethod
    def now_s() -> float:
        """Time of the clock that stamps touches."""
        return time.monotonic()
