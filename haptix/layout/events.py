"""What fingers do on a layout, told to the app in its own thread."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple, get_args

from haptix.checks import choice
from haptix.errors import InputError
from haptix.layout.layout import Layout
from haptix.layout.patch import Patch
from haptix.layout.region import LayoutFacts
from haptix.motion import Facts, Report
from haptix.texture import Feelable

LayoutEventKind = Literal["enter", "leave", "press", "release", "detent"]


class LayoutEvent(NamedTuple):
    """What a finger did, by a real report of it and never by prediction."""

    kind: LayoutEventKind
    patch: Patch | None
    """On which region; None on a material that fills the screen."""
    touch_id: int
    t_s: float
    """Stamp of the report."""
    x_mm: float
    y_mm: float
    detent: float
    """Number of the detent, for that kind; else NaN."""


class _Finger(NamedTuple):
    facts: Facts
    report: Report


class Listeners:
    """Callbacks of an app, called while it gives touches."""

    def __init__(self) -> None:
        self._callbacks: dict[str, list[Callable[[LayoutEvent], None]]] = {}
        self._fingers: dict[int, _Finger] = {}

    def on(self, kind: LayoutEventKind, callback: Callable[[LayoutEvent], None]) -> None:
        """Call a function at each event of a kind."""
        choice("on", kind, get_args(LayoutEventKind))
        if not callable(callback):
            raise InputError(f"on: expected a function of the event, got {callback!r:.80}")
        self._callbacks.setdefault(kind, []).append(callback)

    def forget(self) -> None:
        """Forget all fingers; a renderer starts anew."""
        self._fingers.clear()

    def report(self, texture: Feelable, touch_id: int, t_s: float, now: Report) -> None:
        """Take a real report of a finger; `now` is on the clock of samples, `t_s` its stamp."""
        if not self._callbacks:
            return
        before = self._fingers.pop(touch_id, None)
        if before is None and not now.is_down:
            return
        was = Facts(down_s=now.t_s) if before is None else before.facts
        facts = texture.evaluator.react(was, None if before is None else before.report, now)
        if now.is_down:
            self._fingers[touch_id] = _Finger(facts, now)
            if facts is was and before is not None:
                return  # as mostly: nothing has happened
        place = now if now.is_down or before is None else before.report
        for kind, patch, detent in _changes(texture, was, facts, now.is_down):
            event = LayoutEvent(kind, patch, touch_id, t_s, place.x_mm, place.y_mm, detent)
            for callback in self._callbacks.get(kind, ()):
                callback(event)


def _changes(
    texture: Feelable, was: Facts, now: Facts, is_down: bool
) -> list[tuple[LayoutEventKind, Patch | None, float]]:
    found: list[tuple[LayoutEventKind, Patch | None, float]] = []
    nan = float("nan")
    old: dict[int, Facts] = was.of if isinstance(was, LayoutFacts) else {}
    new: dict[int, Facts] = now.of if isinstance(now, LayoutFacts) else {}
    patches: dict[int, Patch] = {}
    if isinstance(layout := texture.evaluator, Layout):
        patches = layout.patches
    else:
        old, new = {0: was}, {0: now}
    for key, facts in old.items():
        if key not in new:
            if _is_pressed(facts):
                found.append(("release", patches.get(key), nan))
            found.append(("leave", patches.get(key), nan))
    for key, facts in new.items():
        patch, before = patches.get(key), old.get(key)
        if before is None:
            found.append(("enter", patch, nan))
            before = Facts()
        if _is_later(facts.press_s, before.press_s):
            found.append(("press", patch, nan))
        if _is_later(facts.release_s, before.release_s):
            found.append(("release", patch, nan))
        if _is_later(facts.detent_s, before.detent_s):
            found.append(("detent", patch, facts.detent))
    return found


def _is_pressed(facts: Facts) -> bool:
    # NaN, for what has not happened, compares false.
    return facts.press_s == facts.press_s and not facts.release_s >= facts.press_s


def _is_later(now_s: float, before_s: float) -> bool:
    return now_s == now_s and not now_s <= before_s
