"""The kind of campaigns "calibration-fits": fits of many sessions, and by other priors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Literal

from pydantic import Field, PositiveFloat

from calibration.parameters import Parameters
from calibration.reduction import Reduced
from calibration.session import Session
from calibration.steps import FIT, REDUCED, fit_reduced, rig_check
from haptix.campaign.kinds import Campaign, CampaignTask, Outcome, Value, places_of
from haptix.errors import FileFormatError
from haptix.files import read_text
from haptix.finger import Finger
from haptix.screen import Screen


class CalibrationFits(Campaign):
    """A fit of each session, and one more for each prior that is tried, see `fit_folder`.

    Parameters
    ----------
    sessions : tuple of str
        Folders with a ``reduced.csv``, relative to the campaign's file; a pattern such as
        ``screens/*`` stands for several.
    priors : mapping
        Spreads of the prior to be tried, one at a time, by parameter: ``{youngs_modulus_pa =
        [0.15, 0.6]}``. The strokes are fitted with the usual ones as well.
    fixed : mapping
        Values at which parameters are held.
    leaky_gap : bool
        Whether the gap's resistivity is fitted.
    compare : bool
        Whether the uncertainty is widened by other forms of the model.
    """

    shown = ("h0_m", "h0_m spread")
    maps = (("prior_spread", "h0_m"), ("h0_m", "frictional_shear_stress_pa"))

    kind: Literal["calibration-fits"]
    sessions: Annotated[tuple[str, ...], Field(min_length=1)]
    priors: Annotated[dict[str, tuple[PositiveFloat, ...]], Field(default_factory=dict)]
    fixed: Annotated[dict[str, PositiveFloat], Field(default_factory=dict)]
    leaky_gap: bool = False
    compare: bool = True

    def tasks(self) -> Iterator[CampaignTask]:
        """Yield a task for each session with its usual priors, then for each other prior."""
        tried: list[dict[str, list[float | None]]] = [{}]
        tried += [{name: [None, one]} for name, many in self.priors.items() for one in many]
        for folder in places_of(self.sessions, self.folder):
            session = Session.open(folder)
            info = session.info
            known = Parameters.of(info.finger, info.screen, self.leaky_gap).with_rig()
            for name in (*self.priors, *self.fixed):
                known[name]  # an unknown one is refused here, by name
            if not (folder / REDUCED).exists():
                raise FileFormatError(f"{folder}: has no {REDUCED}; `haptix calibrate reduce`")
            rig = rig_check(folder)
            tapped = {} if rig is None else {name: [*one] for name, one in rig.sensor().items()}
            shared = {
                "reduced": read_text(folder / REDUCED),
                "finger": info.finger.model_dump(mode="json", exclude_none=True),
                "screen": info.screen.model_dump(mode="json", exclude_none=True),
                "fixed": self.fixed,
                "leaky_gap": self.leaky_gap,
                "compare": self.compare,
            }
            for other in tried:
                labels: dict[str, Value] = {
                    "session": folder.name,
                    "prior": "",
                    "prior_spread": None,
                }
                for name, (_, spread) in other.items():
                    labels |= {"prior": name, "prior_spread": spread}
                document = {**shared, "priors": {**tapped, **other}}
                yield CampaignTask(self.kind, document, labels)

    @staticmethod
    def run(document: Mapping[str, Any]) -> Outcome:
        """Fit one session by one set of priors."""
        with TemporaryDirectory(prefix="haptix-fit-") as folder:
            path = Path(folder, REDUCED)
            path.write_text(document["reduced"], encoding="utf-8")
            reduced = Reduced.load(path)
        fit, _ = fit_reduced(
            reduced,
            Finger(**document["finger"]),
            Screen(**document["screen"]),
            document["fixed"],
            {name: (value, spread) for name, (value, spread) in document["priors"].items()},
            leaky_gap=document["leaky_gap"],
            compare=document["compare"],
        )
        row: dict[str, Value] = {"theory": fit.theory, "strokes": len(fit.strokes)}
        for one in fit.estimates:
            row[one.name] = fit.best(one.name)
            row[f"{one.name} spread"] = one.spread
            row[f"{one.name} verdict"] = one.verdict
        return Outcome(row, {FIT: fit.save})
