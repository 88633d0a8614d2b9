"""Settings of the renderers."""

from __future__ import annotations

from dataclasses import field
from typing import Annotated, Literal

from pydantic import Field

from firmware_io.playback import LONGEST_HORIZON_S
from haptix.base.checks import Length, NotNegative, Number, Positive, checked
from haptix.base.errors import InputError
from haptix.play.touch import TouchSettings

Combination = Literal["strongest", "first", "mean"]
"""Which finger sets the amplitude of the one electrode that all fingers share."""

LONGEST_S = 1.0
"""Longest block; a larger number was probably meant in milliseconds."""

LONGEST_REACTION_S = 0.1
"""Longest reaction; a larger number was probably meant in milliseconds, and would be too late."""

SLEW_V_PER_S = 4e5
"""Largest slope of the amplitude. An edge of the texture takes 0.5 ms to the full 200 V, in which a
finger at 100 mm/s moves 50 um. A steeper slope would make the screen click."""


@checked()
class Sliding:
    """When a finger counts as sliding. Electrovibration is felt only then.

    Parameters
    ----------
    from_mm_per_s, to_mm_per_s : float
        Speeds of a recorded finger at which it starts and stops sliding. The gap between them
        keeps a hesitating finger from switching the drive. A live finger follows `TouchSettings`.
    fade_s : float
        Time in which the drive fades in and out.
    is_needed : bool
        Whether a finger that stands still gets no voltage.

    Examples
    --------
    >>> Sliding(from_mm_per_s=3.0).to_mm_per_s
    1.0
    """

    from_mm_per_s: NotNegative = 2.0
    to_mm_per_s: NotNegative = 1.0
    fade_s: Positive = 0.005
    is_needed: bool = True

    def __post_init__(self) -> None:
        if self.to_mm_per_s > self.from_mm_per_s:
            raise InputError(
                "expected to_mm_per_s <= from_mm_per_s, got "
                f"{self.to_mm_per_s:g} and {self.from_mm_per_s:g}"
            )


@checked(kw_only=True)
class RenderSettings:
    """How friction becomes an amplitude.

    Parameters
    ----------
    h0_m : float, optional
        Effective thickness of the insulator [m], where the surface spans several. The default is
        the screen's own.
    block_s : float
        Longest block.
    compress : (float, float), optional
        Lowest and highest number of the texture, to be scaled into the reachable range. The
        default replaces friction out of reach by the nearest that can be reached. `RenderStats`
        counts it either way.
    combination : {"strongest", "first", "mean"}
        Which of several fingers' amplitudes the one electrode gets.
    sliding : Sliding
        When a finger gets the drive, and how fast the drive fades.
    slew_v_per_s : float
        Largest slope of the amplitude [V/s].
    keep_blocks : bool
        Keep every `RenderedBlock` in `blocks`, for figures and tests.

    Raises
    ------
    InputError
        If a value is out of its range.
    """

    h0_m: Number | None = None
    block_s: Positive = 0.005
    compress: Annotated[tuple[Number, Number] | None, Field(strict=False)] = None
    combination: Combination = "strongest"
    sliding: Sliding = Sliding()
    slew_v_per_s: Length = SLEW_V_PER_S
    keep_blocks: bool = False

    def __post_init__(self) -> None:
        _not_ms("block_s", self.block_s)
        if self.compress is not None and not self.compress[0] < self.compress[1]:
            raise InputError(f"compress: expected low < high, got {self.compress!r}")


@checked(kw_only=True)
class LiveSettings(RenderSettings):
    """How live touches are followed; the other parameters are those of `RenderSettings`.

    Parameters
    ----------
    touch : TouchSettings
        How touches are filtered and predicted.
    reaction_s : float
        Time from a touch to the first sample that knows of it: wake-up, rendering, transport and
        the driver's guard. Where these take longer, it is as short as they allow.
    horizon_s : float
        Longest stall that is no underrun. What is played so far ahead is provisional: each touch
        renders it again.
    strict : bool
        Raise for a touch that cannot be used. Otherwise it is dropped and counted in
        `touch_counts`.
    own_thread : bool
        Play by the engine in C, in a thread that a busy interpreter does not stop, where all that
        is felt can be compiled and the link is ``tcp:``, ``serial:``, ``usb:`` or, on Linux,
        ``hid:`` (never on Windows). Otherwise the interpreter plays: with sensing, `keep_blocks`,
        a record, or a region or effect of another package's kind. Where one of the last three
        comes while the engine plays, the output pauses at 0 V, and the interpreter goes on.
        `LiveRenderer.plays_by` names the player.

    Examples
    --------
    >>> LiveSettings(block_s=0.002).block_s
    0.002
    """

    touch: TouchSettings = field(default_factory=TouchSettings)
    reaction_s: Positive = 0.003
    horizon_s: Positive = 0.1
    strict: bool = True
    own_thread: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        _not_ms("reaction_s", self.reaction_s, LONGEST_REACTION_S)
        _not_ms("horizon_s", self.horizon_s, LONGEST_HORIZON_S)


def _not_ms(name: str, value: float, most: float = LONGEST_S) -> None:
    if value > most:
        raise InputError(f"{name}: expected {most:g} s at most, got {value:g}; is it in ms?")
