"""A set of stimuli: rendered for its screens, checked as a whole, and put into one folder."""

from __future__ import annotations

from pathlib import Path

from haptix.errors import InputError
from haptix.stimuli.making import Job, Progress, SetResult
from haptix.stimuli.set_plan import SetPlan


class StimulusSet(SetPlan):
    """Stimuli that belong together; the parameters are those of `SetPlan`."""

    def make(
        self,
        folder: str | Path,
        threads: int = 2,
        on_progress: Progress = lambda stage, share: None,
    ) -> SetResult:
        """Render all stimuli, check the whole set, and publish it in a folder.

        Finished files wait in ``.drafts`` within the folder. If the disk fills up or the run is
        stopped, the same call continues from there.

        Raises
        ------
        LimitError
            If any stimulus breaks a limit; nothing is published then.
        RangeError
            If any asks for friction outside the reachable range, unless `unreachable` is "nearest";
            the message has a line for each, with the nearest reachable friction.
        InputError
            If the folder cannot be written.
        """
        job = Job(self, Path(folder), threads, on_progress)
        try:
            return job.run()
        except OSError as error:
            raise InputError(
                f"cannot write to {folder}: {error.strerror or error}; no unfinished file has its "
                "final name, and the same command continues where this one stopped"
            ) from None
