"""A clock that stands until a test moves it."""


class HandClock:
    """Time that passes only where somebody waits, or a test adds to `now_s`."""

    def __init__(self, now_s: float = 100.0) -> None:
        self.now_s = now_s

    def __call__(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        assert seconds >= 0
        self.now_s += seconds
