"""What the renderer asks, whatever a material is made of."""

from __future__ import annotations

from typing import Any, Protocol

from haptix.checks import Array, shown
from haptix.errors import InputError
from haptix.motion import Depends, Facts, Motion, Report
from haptix.texture.field import TargetKind


class Evaluator(Protocol):
    """Answers for blocks of motion; any thread may ask. Every `FrictionField` is one."""

    @property
    def target(self) -> TargetKind:
        """What the answers are, see `haptix.texture.as_mu`."""

    @property
    def outside(self) -> float:
        """The answer where there is nothing to feel."""

    @property
    def depends_on(self) -> Depends:
        """What the answers depend on: what has not changed need not be asked again."""

    @property
    def drives_at_rest(self) -> bool:
        """Whether a finger that does not slide may get voltage."""

    def wanted(self, motion: Motion) -> Array:
        """Friction wanted under the fingers, of the motion's shape."""

    def react(self, facts: Facts, before: Report | None, now: Report) -> Facts:
        """Return a finger's facts after a real report; without `before` it has come down."""


class Feelable(Protocol):
    """What a renderer takes: a field of friction, a material, a layout."""

    @property
    def evaluator(self) -> Evaluator:
        """What answers for it."""


def check_feelable(name: str, texture: Any) -> None:
    """Raise `InputError` unless a renderer can ask a texture."""
    # First the class, whose property is not asked: it may make much.
    has_one = hasattr(type(texture), "evaluator") or hasattr(texture, "evaluator")
    if isinstance(texture, type) or not has_one:
        hint = "haptix.Texture.from_image(path, width_mm=60) reads a photograph"
        raise InputError(
            f"{name}: expected a texture, a material or a layout, got {shown(texture)}; {hint}"
        )
