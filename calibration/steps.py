"""Steps on a session's folder: each reads the files of the one before, and can be repeated."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from datetime import date
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ConfigDict, TypeAdapter

from calibration.fit.fitting import compare_terms, fit_in_best_theory, fit_strokes, other_forms
from calibration.fit.result import Fit, TermNeed
from calibration.keep.practice import TRUTH, PracticeResult, compare_with_truth
from calibration.keep.profile import (
    calibrated_finger,
    calibrated_screen,
    check_name,
    instruments_of,
    write_archive,
)
from calibration.keep.session_report import write_report
from calibration.measure.recording import StrokeRecording
from calibration.measure.reduction import Reduced, reduce_session
from calibration.measure.rig import RIG, RigCheck
from calibration.measure.session import Session
from calibration.plan.parameters import Parameters
from calibration.plan.predict import StrokeConditions, StrokePredictor
from calibration.plan.protocol import (
    CARRIER_HZ,
    FREQUENCY_HZ,
    MU_ERROR,
    Protocol,
    expected_rows,
    expected_spread,
    full_protocol,
    paper_protocol,
    short_protocol,
)
from calibration.verify.budget import uncertainty_budget
from calibration.verify.steadiness import TOLERANCE_JND
from calibration.verify.verification import Verification, verify
from calibration.verify.verification_power import (
    MOST_HELD_OUT,
    chance_of_passing,
    extended_plan,
    with_enough_strokes,
)
from haptix.base.errors import InputError
from haptix.base.files import json_text, parse_json, read_text, reading, write_whole
from haptix.base.task import Context, Result, Task
from haptix.base.version import __version__
from haptix.model.finger import Finger
from haptix.model.friction import ContactModel, in_theory
from haptix.model.pair import FINGER, SCREEN
from haptix.model.screen import CalibrationWarning, Screen
from haptix.model.terms import TERMS

REDUCED, FIT, NEEDS = "reduced.csv", "fit.json", "terms.json"
REPORT, ARCHIVE = "report.html", "archive.zip"
FINISHED = "finished.json"
_RESULTS = (REDUCED, RIG, NEEDS, FIT, SCREEN, FINGER, REPORT, ARCHIVE)
RESTS_ON = (REDUCED, RIG, NEEDS)  # inputs of a verdict beside plan, session and strokes


class Finished(NamedTuple):
    """The result of a session and the hashes of its inputs: the same again computes nothing."""

    verification: Verification
    """The verdict."""
    practice: PracticeResult | None
    """How far a practice was off."""
    strokes_used: int
    """Number of strokes in the fit."""
    made_from: dict[str, str]
    """SHA-256 of each file that it rests on, or that was written."""
    made_by: str = __version__
    """Version of haptix."""

    @classmethod
    def load(cls, folder: Path) -> Finished | None:
        """Return what `finish_folder` kept, if no file and no version has changed since."""
        session, path = Session.open(folder), folder / FINISHED
        if session.open_strokes or not path.exists():
            return None
        try:
            kept = _FINISHED.validate_json(path.read_bytes())
        except ValueError:  # damaged, or of another version: found anew
            return None
        now = session.hashes(*_RESULTS)
        return kept if (kept.made_from, kept.made_by) == (now, __version__) else None


_FINISHED = TypeAdapter(Finished, config=ConfigDict(ser_json_inf_nan="constants"))


def finish_folder(folder: Path, context: Context) -> Finished:
    """Reduce, fit, verify, and compare a practice with its truth."""
    context.progress("fit", 0.0)
    reduce_folder(folder)
    fit, _ = fit_folder(folder)
    context.progress("verify", 0.0)
    verification, screen = verify_folder(folder)
    session, off = Session.open(folder), None
    if screen is not None and (folder / TRUTH).exists():
        off = compare_with_truth(
            folder, max(stroke.voltage_v for stroke in session.protocol.strokes)
        )
    finished = Finished(verification, off, len(fit.strokes), session.hashes(*_RESULTS))
    write_whole(folder / FINISHED, _FINISHED.dump_json(finished).decode())
    return finished


MOST_LOOKS = 3
"""How often a verdict is looked at: twice strokes may be added to decide one."""


def finish_decided(
    folder: Path, context: Context, go_on: Callable[[Session, str], bool] | None = None
) -> tuple[Finished, bool]:
    """Find the verdict; where scatter leaves it open, measure the strokes that would decide it.

    Parameters
    ----------
    folder : Path
        A session without open strokes.
    context : Context
        Of the task.
    go_on : callable, optional
        Gets the session with the strokes that were added, and a question for the person. Returns
        whether all of them were made; the others stay open.

    Returns
    -------
    Finished, bool
        The result, and whether it was known before.
    """
    known = Finished.load(folder)
    done = known or finish_folder(folder, context)
    while go_on is not None and (plan := plan_that_decides(folder, done.verification)) is not None:
        before = Session.open(folder)
        more_s = plan.duration_s - before.protocol.duration_s
        count = len(plan.strokes) - len(before.protocol.strokes)
        question = (
            f"The strokes leave the verdict open. {count} strokes more, some "
            f"{more_s / 60:.1f} minutes, are expected to decide it. Go on?"
        )
        plan.save(folder / "protocol.toml")
        if not go_on(Session.open(folder), question):
            if len(Session.open(folder).open_strokes) == count:
                before.protocol.save(folder / "protocol.toml")  # as it was: the verdict stands
            break
        known, done = None, finish_folder(folder, context)
    return done, known is not None


def plan_that_decides(folder: Path, verification: Verification) -> Protocol | None:
    """Return the plan with the strokes added that would decide a verdict; None for others.

    Held-out strokes are added where the scatter leaves the verdict open, as many as a good screen
    needs to pass in 95 % of sessions where strokes repeat as these did, and at least half as many
    again. Fitted strokes are added where the fit does not determine the insulator.
    """
    session = Session.open(folder)
    protocol, info = session.protocol, session.info
    before = len(protocol.held_out)
    if not verification.is_open or protocol.looks >= MOST_LOOKS or before >= MOST_HELD_OUT:
        return None
    fit = Fit.load(folder / FIT)
    finger = in_theory(info.finger, fit.theory)
    predictor = StrokePredictor(ContactModel(finger, info.screen))
    start = Parameters.of(finger, info.screen).with_rig()
    return extended_plan(predictor, start, protocol, fit, verification)


def written_screen(folder: Path) -> Screen | None:
    """Return the screen's profile that was written, if there is one."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CalibrationWarning)  # the verdict has it
        return Screen.load(folder / SCREEN) if (folder / SCREEN).exists() else None


class PlannedSession(NamedTuple):
    """A protocol, the expected spread of each parameter, and the strokes that snap in.

    `chance` is that of a good screen to pass where strokes repeat within `repeatability`.
    """

    protocol: Protocol
    expected_spread: dict[str, float]
    past_light_contact: int
    repeatability: float
    chance: float

    @property
    def text(self) -> str:
        """One line for people."""
        minutes = self.protocol.duration_s / 60
        return (
            f"{self.protocol.name}, {len(self.protocol.strokes)} strokes, some {minutes:.1f} "
            f"minutes; where strokes repeat within {self.repeatability:.2g}, a good screen passes "
            f"in {self.chance:.0%} of sessions"
        )


def plan_strokes(
    kind: str,
    finger: Finger,
    screen: Screen,
    minutes: float,
    max_voltage_v: float | None = None,
    repeatability: float | None = None,
) -> PlannedSession:
    """Plan a calibration by the protocol "paper", "full" or "short".

    Finger and screen are the assumed ones. A short protocol takes `minutes`. The highest amplitude
    [V] is the screen's limit by default. With the rig's `repeatability` (standard deviation of ln
    mu) strokes are added until a good screen passes in 95 % of sessions. Raises `InputError` if the
    voltage is above the screen's limit, or there is no such protocol.
    """
    limit = screen.max_voltage_v if max_voltage_v is None else max_voltage_v
    if limit > screen.max_voltage_v:
        raise InputError(
            f"--max-voltage-v: expected at most the {screen.max_voltage_v:g} V of screen "
            f"{screen.name!r}, got {limit:g} V"
        )
    predictor = StrokePredictor(ContactModel(finger, screen))
    parameters = Parameters.of(finger, screen).with_rig()
    if kind == "short":
        protocol = short_protocol(predictor, parameters, minutes, limit)
    elif kind in ("paper", "full"):
        protocol = paper_protocol(limit) if kind == "paper" else full_protocol(limit)
    else:
        raise InputError(f"--protocol: expected paper, full or short, got {kind!r}")
    if repeatability is None:
        repeatability = MU_ERROR
        chance = chance_of_passing(predictor, parameters, protocol, repeatability)
    else:
        protocol, chance = with_enough_strokes(
            predictor, parameters, protocol, repeatability, limit
        )
    strokes = StrokeConditions.of(stroke for stroke in protocol.strokes if not stroke.held_out)
    spread = expected_spread(predictor, parameters, strokes)
    _, is_light = expected_rows(predictor, parameters, strokes)
    return PlannedSession(protocol, spread, int((~is_light).sum()), repeatability, chance)


def reduce_folder(folder: str | Path) -> Reduced:
    """Reduce all accepted strokes of a session and write ``reduced.csv``."""
    session = Session.open(folder)
    reduced = _reduced(session, session.recordings)
    reduced.save(session.folder / REDUCED)
    return reduced


def _reduced(session: Session, recordings: list[StrokeRecording]) -> Reduced:
    """Reduce recordings, and take off the gains that the rig's check knows."""
    reduced = reduce_session(recordings, session.protocol.idle_s, session.info.crosstalk)
    rig = rig_check(session.folder)
    return reduced if rig is None else rig.corrected(reduced)


def fit_folder(
    folder: str | Path,
    fixed: Mapping[str, float] | None = None,
    priors: Mapping[str, tuple[float | None, float]] | None = None,
    finger_fit: str | Path | None = None,
    leaky_gap: bool = False,
    terms: Mapping[str, bool] | None = None,
    compare: bool = True,
) -> tuple[Fit, list[TermNeed]]:
    """Fit ``reduced.csv`` and write ``fit.json`` and ``terms.json``.

    For `fixed` and `priors` see `Parameters.fixed` and `Parameters.known`. `finger_fit` is an
    earlier ``fit.json`` of the same finger. With `leaky_gap` the gap's resistivity is fitted, and
    with `compare` it is found which theory and which terms the strokes need, and the uncertainty is
    widened by other forms of the model; `terms` are switched on or off.
    """
    session = Session.open(folder)
    reduced = Reduced.load(session.folder / REDUCED)
    earlier = None if finger_fit is None else Fit.load(finger_fit)
    if earlier is not None:
        earlier.check_unedited(str(finger_fit))
    rig = rig_check(session.folder)
    tapped = {} if rig is None else rig.sensor()
    fit, needs = fit_reduced(
        reduced, session.info.finger, session.info.screen, fixed, {**tapped, **(priors or {})},
        earlier, leaky_gap, terms, compare,
    )  # fmt: skip
    write_whole(session.folder / NEEDS, json_text([asdict(need) for need in needs]))
    fit = fit.signed(session.hashes(*RESTS_ON))
    fit.save(session.folder / FIT)
    return fit, needs


def fit_reduced(
    reduced: Reduced,
    finger: Finger,
    screen: Screen,
    fixed: Mapping[str, float] | None = None,
    priors: Mapping[str, tuple[float | None, float]] | None = None,
    earlier: Fit | None = None,
    leaky_gap: bool = False,
    terms: Mapping[str, bool] | None = None,
    compare: bool = True,
) -> tuple[Fit, list[TermNeed]]:
    """Fit strokes from the assumed finger and screen on; parameters as for `fit_folder`."""
    if earlier is not None:
        finger = in_theory(finger, earlier.theory)
    predictor = StrokePredictor(ContactModel(finger, screen, terms=terms))
    parameters = Parameters.of(finger, screen, leaky_gap).with_rig()
    if earlier is not None:
        parameters = parameters.with_finger(earlier.finger_prior())
    parameters = parameters.known(**priors or {}).fixed(**fixed or {})
    needs: list[TermNeed] = []
    forms = other_forms(predictor.model, terms) if compare else None
    if forms and not terms:
        fit, predictor, parameters = fit_in_best_theory(reduced, predictor, parameters, forms)
    else:
        fit = fit_strokes(reduced, predictor, parameters, forms=forms)
    if compare:
        needs = compare_terms(fit, reduced, predictor, parameters)
    return fit, needs


class FitStrokes(Task):
    """A fit of strokes by priors, see `fit_reduced`.

    `reduced` is the text of a ``reduced.csv``.
    """

    reduced: str
    finger: Finger
    screen: Screen
    fixed: dict[str, float]
    priors: dict[str, tuple[float | None, float]]
    leaky_gap: bool
    compare: bool

    def run(self, context: Context) -> Result:
        """Fit them."""
        path = Path(context.folder or ".", REDUCED)
        path.write_text(self.reduced, encoding="utf-8")
        fit, _ = fit_reduced(**{**dict(self), "reduced": Reduced.load(path)})
        row: dict[str, Any] = {"theory": fit.theory, "strokes": len(fit.strokes)}
        for estimate in fit.estimates:
            row[estimate.name] = fit.best(estimate.name)
            row[f"{estimate.name} spread"] = estimate.spread
            row[f"{estimate.name} verdict"] = estimate.verdict
        return Result(row, files={FIT: fit.save})


def verify_folder(
    folder: str | Path, tolerance_jnd: float = TOLERANCE_JND
) -> tuple[Verification, Screen | None]:
    """Verify profiles by the held-out strokes; write them, report and archive.

    The written profile is the verified one: the held-out strokes are predicted by the contact model
    of ``screen.toml`` and ``finger.toml``, read back from the disk, where the verdict is "failed"
    until then. Where the insulator is not determined there is a report, but no profile: None.
    Raises `FileFormatError` or `InputError` if the fit was edited, or plan, strokes or code are not
    those that it was made from.
    """
    session = Session.open(folder)
    check_name(session.info.screen)
    recordings = session.recordings
    reduced = Reduced.load(session.folder / REDUCED)
    fit = Fit.load(session.folder / FIT)
    fit.check_unchanged(session.hashes(*RESTS_ON))
    _check_reduced(session, reduced, recordings)
    rig, looks = rig_check(session.folder), session.protocol.looks
    believed = session.info.screen
    finger = in_theory(session.info.finger, fit.theory)
    # A term whose parameter is fitted is on even where the profile has no value for it.
    terms = {n: n in fit.terms and not term.missing(finger, believed) for n, term in TERMS.items()}
    predictor = StrokePredictor(ContactModel(finger, believed, terms=terms))
    screen: Screen | None = None
    if fit["h0_m"].value is not None:
        started = min((recording.conditions.started[:10] for recording in recordings), default="")
        by_whom = session.info.operator, instruments_of(recordings), _date(started)
        assumed = {name for recording in recordings for name in recording.assumed}
        measured = calibrated_finger(finger, fit)
        measured.save(session.folder / FINGER)
        make = partial(calibrated_screen, believed, fit, finger=measured)
        make(None, predictor, *by_whom, assumed).save(session.folder / SCREEN)
        written = StrokePredictor(profile_model(session.folder))
        verification = verify(fit, reduced, written, tolerance_jnd, rig, by_whom[2], looks)
        if (verified := verification.verified) is not None:
            highest = verified.highest_v(FREQUENCY_HZ), verified.highest_v(CARRIER_HZ)
            budget = uncertainty_budget(fit, predictor, highest, rig)
            verification = replace(verification, budget=budget)
        screen = make(verification, predictor, *by_whom, assumed)
        screen.save(session.folder / SCREEN)
    else:
        # What would have been written, so that the report shows how well the fit predicts.
        thickness = fit.best("h0_m") * believed.insulator_permittivity
        panel = believed.replace(insulator_thickness_m=thickness)
        best = StrokePredictor(ContactModel(calibrated_finger(finger, fit), panel))
        verification = verify(fit, reduced, best, tolerance_jnd, rig)
        # Profiles of an earlier fit would be taken for this one's.
        for name in (SCREEN, FINGER):
            (session.folder / name).unlink(missing_ok=True)
    needs = _needs(session.folder / NEEDS)
    path, shown = session.folder / REPORT, screen or believed
    is_written = screen is not None
    write_report(path, shown, fit, reduced, verification, predictor, needs, is_written, recordings)
    write_archive(session.folder, session.folder / ARCHIVE)
    return verification, screen


def rig_check(folder: Path) -> RigCheck | None:
    """Return the rig's check of a session's folder; None without."""
    return RigCheck.load(folder / RIG) if (folder / RIG).exists() else None


def profile_model(folder: Path) -> ContactModel:
    """Return the contact model that a renderer builds from the two profiles of a folder."""
    with warnings.catch_warnings():
        # Of a profile that is not verified yet.
        warnings.simplefilter("ignore", CalibrationWarning)
        return ContactModel(Finger.load(folder / FINGER), Screen.load(folder / SCREEN))


def _check_reduced(session: Session, reduced: Reduced, recordings: list[StrokeRecording]) -> None:
    """Raise `InputError` unless ``reduced.csv`` follows from the recordings of all its strokes."""
    recorded = {recording.stroke.number for recording in recordings}
    for stroke in session.protocol.strokes:
        if stroke.number not in recorded and (
            stroke.held_out or any(point.number == stroke.number for point in reduced.points)
        ):
            raise InputError(
                f"stroke {stroke.number} has no recording "
                f"({session.path_of(stroke).relative_to(session.folder)}): restore it, or measure "
                "it with --resume"
            )
    again = _reduced(session, recordings)
    for old, new in zip_longest(reduced.points, again.points):
        if repr(old) != repr(new):  # which takes NaN for equal to itself
            raise InputError(
                f"{REDUCED}: stroke {(new or old).number} is not what its recording gives; "
                "make it anew with `haptix calibrate reduce`, and fit again"
            )


def _needs(path: Path) -> list[TermNeed]:
    if not path.exists():
        return []
    with reading(path, "a list of terms"):
        return TypeAdapter(list[TermNeed]).validate_python(parse_json(read_text(path)))


def _date(text: str) -> date | None:
    try:
        return date.fromisoformat(text) if text else None
    except ValueError:
        raise InputError(f"started: expected an ISO date, got {text!r}") from None
