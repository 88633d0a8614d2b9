"""A set of stimuli: rendered for its screens, checked as a whole, and put into one folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from firmware_io.limits import DriveLimits
from haptix.errors import InputError, LimitError, check_positive
from haptix.finger import Finger
from haptix.perception import Perception
from haptix.screen import Screen
from haptix.stimuli.apparatus import Apparatus
from haptix.stimuli.audio import Container, Encoding, check_format
from haptix.stimuli.population import Population
from haptix.stimuli.stimulus import Stimulus
from haptix.stimuli.trials import TrialPlan

if TYPE_CHECKING:
    from haptix.stimuli.making import SetResult

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class StimulusSet:
    """Stimuli that belong together.

    Parameters
    ----------
    name : str
        What to call it.
    stimuli : tuple of Stimulus
        At least one; no two of one name.
    finger : Finger or Population
        Who is to feel them.
    screens : tuple of Screen
        On what: every stimulus is rendered for each, so that the same friction has each screen's
        own volts.
    sample_rate_hz : float
        Samples per second.
    container, encoding : str
        "wav" or "flac"; "float32" or "24-bit".
    full_scale_v : float
        Voltage of sample 1.0, above the ceiling.
    ceiling_v : float, optional
        Highest voltage of the set; the lowest of the screens' limits without.
    trigger : bool
        Whether files have a trigger channel.
    unreachable : {"reject", "nearest"}
        Whether friction that there is not rejects the set, or gets the nearest that there is.
    trials : TrialPlan
        In which order they come.
    perception : Perception, optional
        Thresholds; those that ship without.
    """

    name: str
    stimuli: tuple[Stimulus, ...]
    finger: Finger | Population
    screens: tuple[Screen, ...]
    sample_rate_hz: float = 48_000.0
    container: Container = "wav"
    encoding: Encoding = "float32"
    full_scale_v: float = 250.0
    ceiling_v: float | None = None
    trigger: bool = True
    unreachable: str = "reject"
    trials: TrialPlan = field(default_factory=TrialPlan)
    perception: Perception = field(default_factory=Perception.default)

    def __post_init__(self) -> None:
        check_format(self.container, self.encoding)
        check_positive("sample_rate_hz", self.sample_rate_hz)
        if self.sample_rate_hz != round(self.sample_rate_hz):
            raise InputError(
                f"sample_rate_hz: audio files need a whole number, got {self.sample_rate_hz:g}"
            )
        if not self.stimuli or not self.screens:
            raise InputError("stimuli and screens: expected at least one of each")
        if self.unreachable not in ("reject", "nearest"):
            raise InputError(
                f'unreachable: expected "reject" or "nearest", got {self.unreachable!r}'
            )
        names = [one.name for one in self.stimuli]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(f"stimuli: two are called {twice[0]!r}; names are those of files")
        taken = sorted({"events", "manifest", "profiles", "sheet"} & set(names))
        if taken:
            raise InputError(f"stimuli: {taken[0]!r} is the name of a file of the set itself")
        screens = [screen.name for screen in self.screens]
        if len(set(screens)) < len(screens):
            raise InputError("screens: two have one name; names tell their files apart")
        check_positive("full_scale_v", self.full_scale_v)
        if self.full_scale_v <= self.limits.ceiling_v:
            raise InputError(
                f"full_scale_v: expected more than the ceiling of {self.limits.ceiling_v:g} V, "
                f"got {self.full_scale_v:g} V"
            )

    @property
    def limits(self) -> DriveLimits:
        """What every sample is held against."""
        lowest = min(screen.max_voltage_v for screen in self.screens)
        ceiling = lowest if self.ceiling_v is None else self.ceiling_v
        if ceiling > lowest:
            raise LimitError(
                f"ceiling_v: {ceiling:g} V is above the {lowest:g} V that the screens may carry"
            )
        return DriveLimits(ceiling_v=ceiling)

    def apparatus(self, screen: Screen) -> Apparatus:
        """Build what the stimuli are rendered through, on one screen."""
        return Apparatus.build(self.finger, screen, self.stimuli, self.limits.ceiling_v)

    def file_name(self, stimulus: Stimulus, screen: Screen) -> str:
        """Name of a drive file."""
        return f"{stimulus.name}{self.suffix(screen)}.{self.container}"

    def suffix(self, screen: Screen) -> str:
        """Tell a screen's files from those of the others, where there are several."""
        return "" if len(self.screens) == 1 else f"_on_{screen.name.replace('/', '-')}"

    def make(
        self,
        folder: str | Path,
        threads: int = 2,
        on_progress: Progress = lambda stage, share: None,
    ) -> SetResult:
        """Render everything, and publish it in a folder when all of it is right.

        Finished files wait in ``.drafts`` within the folder; when the disk fills up or the run is
        stopped, the same call goes on from there.

        Raises
        ------
        LimitError
            If any stimulus breaks a limit; nothing is published then.
        RangeError
            If any asks for friction that there is not, unless `unreachable` is "nearest"; the
            message has a line for each, with the nearest that there is.
        InputError
            If the folder cannot be written.
        """
        from haptix.stimuli.making import Job  # which is made for what this class holds

        job = Job(self, Path(folder), threads, on_progress)
        try:
            return job.run()
        except OSError as error:
            raise InputError(
                f"cannot write to {folder}: {error.strerror or error}; nothing unfinished bears a "
                "final name, and the same command goes on where this one stopped"
            ) from None
