"""Content of a set: the stimuli, who feels them, and the form of its files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

from haptix.checks import Positive, check_fields, choice
from haptix.devices import BODY_CAPACITANCE_F, DriveLimits
from haptix.errors import InputError, LimitError
from haptix.finger import Finger
from haptix.perception import Perception
from haptix.population import Population
from haptix.screen import Screen
from haptix.signals.audio import Container, Encoding, check_format
from haptix.stimuli.apparatus import Apparatus
from haptix.stimuli.stimulus import Stimulus
from haptix.stimuli.trials import TrialPlan


@dataclass(frozen=True)
class SetPlan:
    """Stimuli that belong together.

    Parameters
    ----------
    name : str
        Name of the set.
    stimuli : tuple of Stimulus
        One or more, with different names.
    finger : Finger or Population
        Who feels them.
    screens : tuple of Screen
        Every stimulus is rendered for each screen, with the volts that give its friction there.
    sample_rate_hz : float
        Samples per second.
    container, encoding : str
        "wav" or "flac"; "float32" or "24-bit".
    full_scale_v : float
        Voltage of sample 1.0, above the ceiling.
    ceiling_v : float, optional
        Highest voltage of the set; by default the lowest of the screens' limits.
    trigger : bool
        Whether files have a trigger channel.
    unreachable : {"reject", "nearest"}
        Whether friction outside the reachable range rejects the set, or becomes the nearest
        reachable.
    trials : TrialPlan
        Order of the trials.
    perception : Perception, optional
        Detection thresholds; by default those of the package.
    """

    name: str
    stimuli: tuple[Stimulus, ...]
    finger: Finger | Population
    screens: tuple[Screen, ...]
    sample_rate_hz: Positive = 48_000.0
    container: Container = "wav"
    encoding: Encoding = "float32"
    full_scale_v: Positive = 250.0
    ceiling_v: float | None = None
    trigger: bool = True
    unreachable: str = "reject"
    trials: TrialPlan = field(default_factory=TrialPlan)
    perception: Perception = field(default_factory=Perception.default)

    def __post_init__(self) -> None:
        check_format(self.container, self.encoding)
        check_fields(self)
        if self.sample_rate_hz != round(self.sample_rate_hz):
            raise InputError(
                f"sample_rate_hz: audio files need a whole number, got {self.sample_rate_hz:g}"
            )
        if not self.stimuli or not self.screens:
            raise InputError("stimuli and screens: expected at least one of each")
        choice("unreachable", self.unreachable, ("reject", "nearest"))
        names = [one.name for one in self.stimuli]
        twice = sorted(name for name, count in Counter(names).items() if count > 1)
        if twice:
            raise InputError(f"stimuli: two are called {twice[0]!r}; names are those of files")
        taken = sorted({"events", "manifest", "profiles", "sheet"} & set(names))
        if taken:
            raise InputError(f"stimuli: {taken[0]!r} is the name of a file of the set itself")
        screens = [screen.name for screen in self.screens]
        if len(set(screens)) < len(screens):
            raise InputError("screens: two have the same name, and so would their files")
        if self.full_scale_v <= self.limits.ceiling_v:
            raise InputError(
                f"full_scale_v: expected more than the ceiling of {self.limits.ceiling_v:g} V, "
                f"got {self.full_scale_v:g} V"
            )

    @cached_property
    def limits(self) -> DriveLimits:
        """Limits that every sample is checked against."""
        return drive_limits(self.screens, self.ceiling_v)

    def apparatus(self, screen: Screen) -> Apparatus:
        """Build what the stimuli are rendered through, on one screen."""
        return Apparatus.build(self.finger, screen, self.stimuli, self.limits.ceiling_v)

    def suffix(self, screen: Screen) -> str:
        """End of the names of a screen's files, where there are several screens."""
        return "" if len(self.screens) == 1 else f"_on_{screen.name.replace('/', '-')}"

    def file_name(self, stimulus: Stimulus, screen: Screen) -> str:
        """Name of a drive file."""
        return f"{stimulus.name}{self.suffix(screen)}.{self.container}"


def drive_limits(screens: Sequence[Screen], ceiling_v: float | None = None) -> DriveLimits:
    """Limits of a drive for several screens: those of the lowest, or a lower ceiling [V].

    Raises
    ------
    LimitError
        If the ceiling is above what a screen may carry.
    """
    lowest = min(screen.max_voltage_v for screen in screens)
    ceiling = lowest if ceiling_v is None else ceiling_v
    if ceiling > lowest:
        raise LimitError(
            f"ceiling_v: {ceiling:g} V is above the {lowest:g} V that the screens may carry"
        )
    bodies = [screen.body_capacitance_f for screen in screens]
    return DriveLimits(ceiling_v=ceiling, capacitance_f=max(BODY_CAPACITANCE_F, *bodies))
