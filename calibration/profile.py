"""Profiles of screen and finger: the result of a calibration, and the start of later sessions."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Mapping
from datetime import UTC, date, datetime
from pathlib import Path

from calibration.fit import Fit
from calibration.parameters import PER_FINGER
from calibration.predict import StrokePredictor
from calibration.recording import StrokeRecording
from calibration.verification import Verification
from haptix.errors import InputError
from haptix.files import write_whole
from haptix.finger import Finger, Roughness
from haptix.screen import Calibration, Screen

SCREEN, FINGER = "screen.toml", "finger.toml"
"""Names of the two profiles in a session's folder."""


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

    Without a `verification` its verdict is "failed": it is what is still to be verified.
    `instruments` are names with serial numbers, `assumed` signals that none of them measured.
    Without `measured_on` the date is today's. `finger` is the one that is written beside it.

    Raises
    ------
    InputError
        If the strokes do not determine the insulator: there is no profile then.
    """
    check_name(screen)
    changed: dict[str, object] = {
        "insulator_thickness_m": fit.value("h0_m") * screen.insulator_permittivity
    }
    found = [fit["h0_m"]]
    if "gap_resistivity_ohm_m" in fit.names:
        found.append(fit["gap_resistivity_ohm_m"])
        changed["gap_resistivity_ohm_m"] = found[-1].value
    calibration = Calibration(
        date=measured_on or datetime.now(UTC).date(),
        operator=operator,
        instruments=tuple(sorted(set(instruments))),
        verdict="failed" if verification is None else verification.verdict,
        spread={one.name: one.spread for one in found if one.value is not None},
        rests_on=(
            *_assumptions(fit, predictor),
            *(f"{name} (not measured)" for name in sorted(set(assumed))),
            *(f"{one} (not checked)" for one in (verification.untested if verification else ())),
        ),
        finger_hash="" if finger is None else finger.content_hash(),
    )
    calibrated = screen.replace(**changed, is_placeholder=False, calibration=calibration)
    signed = calibration.model_copy(update={"content_hash": calibrated.content_hash()})
    return calibrated.replace(calibration=signed)


def _assumptions(fit: Fit, predictor: StrokePredictor) -> list[str]:
    placeholders = predictor.model.placeholders()
    found = [f"{name} (placeholder)" for name in placeholders if "screen" not in name]
    for verdict, note in (("fixed", "held fixed"), ("prior", "its prior")):
        found += [f"{one.name} ({note})" for one in fit.estimates if one.verdict == verdict]
    return found


def calibrated_finger(finger: Finger, fit: Fit) -> Finger:
    """Return the finger with which the fit predicts.

    Its numbers belong together: a single one is measured only if the fit determines it.
    """
    found = finger_at(finger, {name: fit.best(name) for name in PER_FINGER})
    return found.replace(theory=fit.theory or finger.theory)


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
    if bulk is not None:  # in proportion: see calibration.predict
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
