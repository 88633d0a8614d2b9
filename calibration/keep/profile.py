"""Profiles of screen and finger, the result of a calibration, and comparisons of two."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime
from math import exp, hypot, nan
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from calibration.fit.result import Fit
from calibration.measure.recording import StrokeRecording
from calibration.measure.reduction import Reduced
from calibration.plan.parameters import PER_FINGER, Array
from calibration.plan.predict import StrokePredictor
from calibration.verify.steadiness import Drift
from calibration.verify.verification import FEWEST_OF_GROUP, HeldOutStroke, Verification
from haptix.base.checks import positive
from haptix.base.errors import InputError
from haptix.base.files import write_whole
from haptix.base.report import Heading
from haptix.model.contact import TheoryName
from haptix.model.finger import Finger, Roughness
from haptix.model.friction import ContactModel, in_theory
from haptix.model.perception.thresholds import WEBER_FRACTION
from haptix.model.presets import DEFAULT_CARRIER_HZ
from haptix.model.screen import Calibration, Screen
from haptix.model.status import Status

_VOLTAGES = 81  # of each curve: mu between them within 1e-4


def check_name(screen: Screen) -> None:
    """Raise `InputError` unless the screen has a name of its own."""
    if screen.name.strip() in ("", "custom"):
        raise InputError(
            f"expected a screen with a name of its own, got {screen.name!r}: use "
            'screen.replace(name="...") so that outputs can say which screen they are for'
        )


def calibrated_screen(
    screen: Screen,
    fit: Fit,
    verification: Verification | None,
    predictor: StrokePredictor,
    operator: str = "",
    instruments: Iterable[str] = (),
    measured_on: date | None = None,
    assumed: Iterable[str] = (),
    finger: Finger | None = None,
) -> Screen:
    """Return the screen with the fitted numbers; name, permittivity and limits are kept.

    Parameters
    ----------
    screen : Screen
        The screen before.
    fit : Fit
        The fit.
    verification : Verification or None
        The verdict; without one it is "failed", since it is still to be verified.
    predictor : StrokePredictor
        The model of the fit.
    operator : str
        Who measured.
    instruments : iterable of str
        Names with serial numbers.
    measured_on : date, optional
        Today if not given.
    assumed : iterable of str
        Signals that no instrument measured.
    finger : Finger, optional
        The finger that is written beside it.

    Raises
    ------
    InputError
        If the strokes do not determine the insulator: there is no profile then.
    """
    check_name(screen)
    changed: dict[str, object] = {
        "insulator_thickness_m": fit.value("h0_m") * screen.insulator_permittivity
    }
    estimates = [fit["h0_m"]]
    if "gap_resistivity_ohm_m" in fit.names:
        estimates.append(fit["gap_resistivity_ohm_m"])
        changed["gap_resistivity_ohm_m"] = estimates[-1].value
    calibration = Calibration(
        date=measured_on or datetime.now(UTC).date(),
        operator=operator,
        instruments=tuple(sorted(set(instruments))),
        verdict="failed" if verification is None else verification.verdict,
        spread={
            estimate.name: estimate.spread for estimate in estimates if estimate.value is not None
        },
        rests_on=(
            *_assumptions(fit, predictor),
            *(f"{name} (not measured)" for name in sorted(set(assumed))),
            *(f"{text} (not checked)" for text in (verification.untested if verification else ())),
        ),
        verified=verification.verified if verification and not verification.failures else None,
        finger_hash="" if finger is None else finger.content_hash(),
    )
    calibrated = screen.replace(**changed, is_placeholder=False, calibration=calibration)
    signed = calibration.model_copy(update={"content_hash": calibrated.content_hash()})
    return calibrated.replace(calibration=signed)


def _assumptions(fit: Fit, predictor: StrokePredictor) -> list[str]:
    placeholders = predictor.model.placeholders()
    assumptions = [f"{name} (placeholder)" for name in placeholders if "screen" not in name]
    for verdict, note in (("fixed", "held fixed"), ("prior", "its prior")):
        assumptions += [
            f"{estimate.name} ({note})" for estimate in fit.estimates if estimate.verdict == verdict
        ]
    return assumptions


def calibrated_finger(finger: Finger, fit: Fit) -> Finger:
    """Return the finger that the fit predicts with.

    Its numbers belong together: a single one is measured only if the fit determines it.

    Parameters
    ----------
    finger : Finger
        The finger before.
    fit : Fit
        The fit.
    """
    fitted = finger_at(finger, {name: fit.best(name) for name in PER_FINGER})
    return fitted.replace(theory=fit.theory)


def finger_at(finger: Finger, values: Mapping[str, float]) -> Finger:
    """Return a finger with the values of all parameters of `PER_FINGER`; others are ignored."""
    roughness = finger.roughness
    if isinstance(roughness, Roughness):
        roughness = roughness.model_copy(update={"h_rms_m": values["h_rms_m"]})
    else:
        share = values["h_rms_m"] / float(roughness.spectrum().h_rms_m)
        roughness = roughness.model_copy(
            update={"density_m4": tuple(share**2 * c for c in roughness.density_m4)}
        )
    bulk = finger.bulk_modulus_pa
    if bulk is not None:  # in proportion: see calibration.plan.predict
        bulk = float(bulk) * values["youngs_modulus_pa"] / float(finger.youngs_modulus_pa)
    scale = {"scale": values["skin_dielectric_scale"]}
    same = set(PER_FINGER) - {"h_rms_m", "skin_dielectric_scale"}
    return finger.replace(
        **{name: values[name] for name in same},
        bulk_modulus_pa=bulk,
        roughness=roughness,
        dielectric=finger.dielectric.model_copy(update=scale),
    )


def instruments_of(recordings: Iterable[StrokeRecording]) -> set[str]:
    """Names and serial numbers of all instruments in use."""
    return {
        f"{name}: {serial}"
        for recording in recordings
        for name, serial in recording.conditions.instruments.items()
    }


def write_archive(folder: Path, path: Path) -> None:
    """Pack a session's folder, raw recordings included, into one zip file, whole or not at all."""
    files = [file for file in sorted(folder.rglob("*")) if file.is_file() and file != path]

    def write(draft: Path) -> None:
        with zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED) as archive:
            for file in files:
                archive.write(file, file.relative_to(folder.parent))

    write_whole(path, write)


@dataclass(frozen=True)
class MatchedFriction:
    """One friction that both screens can give, as a mean over the fingers (of the logarithm)."""

    normal_force_n: float
    frequency_hz: float
    """Where."""
    mu: Annotated[float, Heading("mu", ".3g")]
    """The friction."""
    voltage_a_v: Annotated[float, Heading("A [V]", ".1f")]
    voltage_b_v: Annotated[float, Heading("B [V]", ".1f")]
    """Amplitude that gives it on each screen [V]."""
    difference_jnd: Annotated[float, Heading("screens [JND]", "+.2f")]
    """Part of the screens: friction on B minus that on A under the same finger, where both have A's
    voltage, in just-noticeable differences; NaN past B's light contact."""
    uncertainty_jnd: Annotated[float, Heading("± [JND]", ".2f")]
    """90 % uncertainty of that difference, from the spread of both profiles' insulators and from
    finger to finger; NaN where a profile states none."""
    fingers_jnd: Annotated[float, Heading("fingers [JND]", ".2f")]
    """Part of the fingers: highest friction minus lowest on the same screen, at A's voltage."""


@dataclass(frozen=True)
class Match:
    """Range of friction that both screens give at one force, and voltages in it.

    Where the ranges do not overlap `mu_high` is below `mu_low` and there are no levels.
    """

    normal_force_n: float
    mu_low: float
    mu_high: float
    levels: tuple[MatchedFriction, ...]

    @property
    def text(self) -> str:
        """One line for people."""
        if not self.levels:
            return f"no friction that both give: {self.mu_low:.3g} is above {self.mu_high:.3g}"
        return f"both give mu {self.mu_low:.3g} to {self.mu_high:.3g}"


_LAWS: tuple[TheoryName, ...] = ("open-gaps", "corrected", "local")
"""Forms of the mean field that fingers were found to follow."""


def match_screens(
    a: Screen,
    b: Screen,
    fingers: Sequence[Finger],
    normal_force_n: Sequence[float] = (0.2, 0.5, 0.8),
    frequency_hz: float = DEFAULT_CARRIER_HZ,
    levels: int = 5,
) -> list[Match]:
    """Compare two screens under the same fingers, at each force [N].

    Friction is that of the steady attraction at an amplitude and a frequency, as surfaces hold it:
    by default the carrier of `haptix render`. The uncertainty has the spread of the fingers, that
    of both insulators, and that of the forms of the mean field: each finger may follow another.
    """
    positive("frequency_hz", frequency_hz)
    if levels < 2:
        raise InputError(f"levels: expected 2 or more, got {levels}")
    curves_a, curves_b = (_Curves(profile, fingers, frequency_hz) for profile in (a, b))
    by_law = [
        [_Curves(profile, [in_theory(one, law) for one in fingers], frequency_hz)
         for profile in (a, b)]
        for law in _LAWS
    ]  # fmt: skip
    matches = []
    for force in normal_force_n:
        positive("normal_force_n", force)
        of_a, of_b = curves_a.at(force), curves_b.at(force)
        of_laws = [[curves.at(force) for curves in law] for law in by_law]
        mean_a, mean_b = ((log_mu.mean(0), volts) for volts, log_mu in (of_a, of_b))
        low, high = max(mean_a[0][0], mean_b[0][0]), min(mean_a[0][-1], mean_b[0][-1])
        rows = []
        for log_mu in np.linspace(low, high, levels) if high > low else ():
            at_a, at_b = float(np.interp(log_mu, *mean_a)), float(np.interp(log_mu, *mean_b))
            each_a, each_b = _at(of_a, at_a), _at(of_b, at_a)
            difference = each_b - each_a
            between = float(difference.std(ddof=1)) if len(fingers) > 1 else 0.0
            in_laws = [_at(on_b, at_a) - _at(on_a, at_a) for on_a, on_b in of_laws]
            law = float(np.sqrt(np.nanvar(in_laws, axis=0, ddof=1).mean()))
            spreads = curves_a.spread(force, at_a), curves_b.spread(force, at_b)
            log_sd = hypot(*spreads, between, law)
            rows.append(
                MatchedFriction(
                    force,
                    frequency_hz,
                    exp(log_mu),
                    at_a,
                    at_b,
                    float(np.expm1(difference.mean())) / WEBER_FRACTION,
                    1.645 * log_sd / WEBER_FRACTION,
                    float(np.expm1(np.ptp(each_a))) / WEBER_FRACTION,
                )
            )
        matches.append(Match(force, exp(low), exp(high), tuple(rows)))
    return matches


def _at(curves: tuple[Array, Array], voltage_v: float) -> Array:
    """Ln mu of each finger at a voltage; NaN past the light contact."""
    volts, log_mu = curves
    return np.array([np.interp(voltage_v, volts, values, right=np.nan) for values in log_mu])


class _Curves:
    """Friction of one screen over its voltages, as far as the contact of all fingers is light."""

    def __init__(self, screen: Screen, fingers: Sequence[Finger], frequency_hz: float) -> None:
        self._screen, self._frequency_hz = screen, frequency_hz
        self._models = [ContactModel(finger, screen) for finger in fingers]
        made = screen.calibration
        self._log_sd = nan if made is None else made.spread.get("h0_m", nan)

    def at(self, force: float, h0_factor: float = 1.0) -> tuple[Array, Array]:
        """Voltages [V], shape (volts,), and ln mu at them, shape (fingers, volts)."""
        volts, h0_m = np.linspace(0.0, self._screen.max_voltage_v, _VOLTAGES), self._screen.h0_m
        states = [model.solve(force, volts, self._frequency_hz, h0_m * h0_factor)
                  for model in self._models]  # fmt: skip
        is_ok = np.all([np.asarray(state.status) == int(Status.OK) for state in states], axis=0)
        light = np.cumprod(is_ok).astype(bool)
        if not light.any():
            raise InputError(f"screen {self._screen.name!r}: no light contact at {force:g} N")
        return volts[light], np.log([np.asarray(state.mu, dtype=float)[light] for state in states])

    def spread(self, force: float, voltage_v: float) -> float:
        """Standard deviation of ln mu at a voltage, from that of the insulator."""
        if not self._log_sd > 0:
            return self._log_sd
        low, high = (
            np.interp(voltage_v, volts, log_mu.mean(0))
            for volts, log_mu in (self.at(force, exp(side * self._log_sd)) for side in (-1, 1))
        )
        return float(abs(high - low)) / 2


@dataclass(frozen=True)
class ProfileCheck:
    """Strokes against a profile."""

    strokes: tuple[HeldOutStroke, ...]
    """Every good stroke and its prediction."""
    drifts: dict[str, Drift]
    """Of "all" strokes, and of those "without_voltage" and "with_voltage": another finger or
    cleaning shifts both, a changed insulator or drive the driven ones alone."""

    @property
    def passed(self) -> bool:
        """Whether friction of all, and of the driven strokes, is within half a JND."""
        return all(self.drifts[name].is_within for name in ("all", "with_voltage"))

    @property
    def verdict(self) -> Literal["passed", "failed"]:
        """The same in a word."""
        return "passed" if self.passed else "failed"


def check_profile(reduced: Reduced, predictor: StrokePredictor) -> ProfileCheck:
    """Compare all good strokes with a predictor of the profiles, none of which it was fitted to.

    Raises `InputError` if there are fewer than two good strokes with a voltage.
    """
    points = [point for point in reduced.points if not point.outlier]
    driven = np.array([point.voltage_v > 0 for point in points], dtype=bool)
    if driven.sum() < FEWEST_OF_GROUP:
        raise InputError(
            f"expected {FEWEST_OF_GROUP} good strokes with a voltage or more, got {driven.sum()}"
        )
    rows = HeldOutStroke.predicted(points, predictor)
    residuals = np.array([row.residual_jnd for row in rows])
    groups = {"all": residuals, "with_voltage": residuals[driven]}
    groups["without_voltage"] = residuals[~driven]
    return ProfileCheck(rows, {name: Drift.of(values) for name, values in groups.items()})
