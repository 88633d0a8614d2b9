"""The steps on a session's folder: each reads what the one before has left, and can be repeated."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from datetime import date
from pathlib import Path
from typing import NamedTuple

from calibration.comparison import TermNeed, compare_terms
from calibration.fitting import Fit, fit_strokes
from calibration.parameters import Parameters
from calibration.predict import StrokePredictor
from calibration.profile import (
    calibrated_finger,
    calibrated_screen,
    check_name,
    instruments_of,
    write_archive,
)
from calibration.reduction import Reduced, reduce_session
from calibration.report import write_report
from calibration.session import Session
from calibration.verification import TOLERANCE_THRESHOLDS, Verification, verify
from haptix.errors import FileFormatError, InputError
from haptix.files import json_text, write_whole
from haptix.friction import ContactModel
from haptix.screen import Screen
from haptix.terms import TERMS

REDUCED, FIT, NEEDS = "reduced.csv", "fit.json", "terms.json"
SCREEN, FINGER, REPORT, ARCHIVE = "screen.toml", "finger.toml", "report.html", "archive.zip"


class Verified(NamedTuple):
    """What the last step leaves: its verdict, and the profile where there is one."""

    verification: Verification
    screen: Screen | None


def predictor_of(session: Session, terms: Mapping[str, bool] | None = None) -> StrokePredictor:
    """Return the model of a session's finger and screen; `terms` switches single ones."""
    return StrokePredictor(ContactModel(session.info.finger, session.info.screen, terms=terms))


def reduce_folder(folder: str | Path) -> Reduced:
    """Reduce all accepted strokes of a session and write ``reduced.csv``."""
    session = Session.open(folder)
    found = reduce_session(session.recordings, session.protocol.idle_s, session.info.crosstalk)
    found.save(session.folder / REDUCED)
    return found


def fit_folder(
    folder: str | Path,
    fixed: Mapping[str, float] | None = None,
    priors: Mapping[str, tuple[float | None, float]] | None = None,
    finger_fit: str | Path | None = None,
    leaky_gap: bool = False,
    terms: Mapping[str, bool] | None = None,
    compare: bool = True,
    seed: int = 0,
) -> tuple[Fit, list[TermNeed]]:
    """Fit ``reduced.csv`` and write ``fit.json`` and ``terms.json``.

    Parameters
    ----------
    folder : path-like
        Session.
    fixed : mapping of str to float, optional
        Parameters held at values.
    priors : mapping of str to (float or None, float), optional
        Values (None keeps the start) and standard deviations of logarithms.
    finger_fit : path-like, optional
        An earlier ``fit.json`` of the same finger.
    leaky_gap : bool
        Whether to fit the gap's resistivity.
    terms : mapping of str to bool, optional
        Terms to switch.
    compare : bool
        Whether to ask which terms the strokes need.
    seed : int
        Of the bootstrap.
    """
    session = Session.open(folder)
    reduced = Reduced.load(session.folder / REDUCED)
    predictor = predictor_of(session, terms)
    parameters = Parameters.of(session.info.finger, session.info.screen, leaky_gap)
    if finger_fit is not None:
        parameters = parameters.with_finger(Fit.load(finger_fit).finger_prior())
    if priors:
        parameters = parameters.known(**priors)
    if fixed:
        parameters = parameters.fixed(**fixed)
    fit = fit_strokes(reduced, predictor, parameters, seed)
    fit.save(session.folder / FIT)
    needs = compare_terms(fit, reduced, predictor, parameters) if compare else []
    write_whole(session.folder / NEEDS, json_text([asdict(one) for one in needs]))
    return fit, needs


def verify_folder(
    folder: str | Path, tolerance_thresholds: float = TOLERANCE_THRESHOLDS
) -> Verified:
    """Judge ``fit.json`` by the held-out strokes and write profiles, report and archive.

    Where the insulator is not determined there is a report, but no profile.
    """
    session = Session.open(folder)
    check_name(session.info.screen)
    reduced = Reduced.load(session.folder / REDUCED)
    fit = Fit.load(session.folder / FIT)
    predictor = predictor_of(session, _terms(fit.terms, session))
    found = verify(fit, reduced, predictor, tolerance_thresholds)
    recordings = session.recordings
    started = min((one.conditions.started[:10] for one in recordings), default="")
    screen: Screen | None = None
    if fit["h0_m"].value is not None:
        screen = calibrated_screen(
            session.info.screen,
            fit,
            found,
            predictor,
            session.info.operator,
            instruments_of(recordings),
            _date(started),
        )
        screen.save(session.folder / SCREEN)
        calibrated_finger(session.info.finger, fit).save(session.folder / FINGER)
    else:
        # What an earlier fit has left would be taken for this one's.
        for name in (SCREEN, FINGER):
            (session.folder / name).unlink(missing_ok=True)
    write_report(
        session.folder / REPORT,
        screen or session.info.screen,
        fit,
        reduced,
        found,
        predictor,
        _needs(session.folder / NEEDS),
        profile_is_written=screen is not None,
    )
    write_archive(session.folder, session.folder / ARCHIVE)
    return Verified(found, screen)


def _terms(on: Iterable[str], session: Session) -> dict[str, bool]:
    # A term whose parameter is fitted is on even where the profile has no value for it.
    finger, screen, names = session.info.finger, session.info.screen, set(on)
    return {name: name in names and not TERMS[name].missing(finger, screen) for name in TERMS}


def _needs(path: Path) -> list[TermNeed]:
    try:
        return [TermNeed(**one) for one in json.loads(path.read_text(encoding="utf-8"))]
    except FileNotFoundError:
        return []
    except (OSError, TypeError, ValueError) as error:
        raise FileFormatError(f"{path}: expected a list of terms, got {error!r}") from None


def _date(text: str) -> date | None:
    try:
        return date.fromisoformat(text) if text else None
    except ValueError:
        raise InputError(f"started: expected an ISO date, got {text!r}") from None
