"""The screen profile: what a calibration leaves behind, and every later session starts from."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable
from datetime import UTC, date, datetime
from pathlib import Path

from calibration.fitting import Fit
from calibration.predict import StrokePredictor
from calibration.recording import StrokeRecording
from calibration.verification import Verification
from haptix.errors import InputError
from haptix.files import write_whole
from haptix.finger import Finger, Roughness
from haptix.screen import Calibration, Screen


def write_screen_profile(screen: Screen, path: str | Path, overwrite: bool = False) -> None:
    """Write a calibrated screen as TOML.

    Parameters
    ----------
    screen : Screen
        The calibrated screen, under a name of its own.
    path : path-like
        File to write.
    overwrite : bool
        Whether an existing profile may be replaced.

    Raises
    ------
    InputError
        If the file exists and may not be replaced, or the screen has no name of its own.
    """
    check_name(screen)
    path = Path(path)
    if path.exists() and not overwrite:
        raise InputError(f"{path} exists: pass overwrite=True to replace that calibration")
    screen.save(path)


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
    verification: Verification,
    predictor: StrokePredictor,
    operator: str = "",
    instruments: Iterable[str] = (),
    measured_on: date | None = None,
) -> Screen:
    """Return the screen as the fit has found it.

    Parameters
    ----------
    screen : Screen
        As it was believed to be; its name, permittivity and limits are kept.
    fit, verification, predictor
        What was found, how it was judged, and by which model.
    operator : str
        Who measured.
    instruments : iterable of str
        With what.
    measured_on : date, optional
        Today's without.

    Raises
    ------
    InputError
        If the strokes do not determine the insulator: there is no profile then.
    """
    check_name(screen)
    changed: dict[str, object] = {
        "insulator_thickness_m": fit.value("h0_m") * screen.insulator_permittivity
    }
    spread = {"h0_m": fit["h0_m"].spread}
    if "gap_resistivity_ohm_m" in fit.names:
        leak = fit["gap_resistivity_ohm_m"]
        changed["gap_resistivity_ohm_m"] = leak.value
        if leak.value is not None:
            spread["gap_resistivity_ohm_m"] = leak.spread
    calibration = Calibration(
        date=measured_on or datetime.now(UTC).date(),
        operator=operator,
        instruments=tuple(sorted(set(instruments))),
        verdict="passed" if verification.passed else "failed",
        spread=spread,
        rests_on=tuple(rests_on(fit, predictor)),
    )
    found = screen.replace(**changed, is_placeholder=False, calibration=calibration)
    signed = calibration.model_copy(update={"content_hash": found.content_hash()})
    return found.replace(calibration=signed)


def rests_on(fit: Fit, predictor: StrokePredictor) -> list[str]:
    """Name what a calibration takes for granted."""
    model = predictor.model
    found = [f"{name} (stand-in)" for name in model.placeholders() if "screen" not in name]
    held = [one.name for one in fit.estimates if one.verdict == "fixed"]
    known = [one.name for one in fit.estimates if one.verdict == "prior"]
    found += [f"{name} (held fixed)" for name in held]
    found += [f"{name} (its prior)" for name in known]
    return found


def calibrated_finger(finger: Finger, fit: Fit) -> Finger:
    """Return the finger with which the fit predicts.

    Its numbers belong together: single ones among them are not measured unless the fit says so.
    """
    roughness = finger.roughness
    if isinstance(roughness, Roughness):
        roughness = roughness.model_copy(update={"h_rms_m": fit.best("h_rms_m")})
    else:
        share = fit.best("h_rms_m") / float(roughness.spectrum().h_rms_m)
        roughness = roughness.model_copy(
            update={"density_m4": tuple(share**2 * c for c in roughness.density_m4)}
        )
    modulus = fit.best("youngs_modulus_pa")
    bulk = finger.bulk_modulus_pa
    if bulk is not None:  # in proportion: see calibration.predict
        bulk = float(bulk) * modulus / float(finger.youngs_modulus_pa)
    return finger.replace(
        youngs_modulus_pa=modulus,
        bulk_modulus_pa=bulk,
        frictional_shear_stress_pa=fit.best("frictional_shear_stress_pa"),
        apparent_area_at_1n_m2=fit.best("apparent_area_at_1n_m2"),
        apparent_area_exponent=fit.best("apparent_area_exponent"),
        response_hz_per_mm_per_s=fit.best("response_hz_per_mm_per_s"),
        roughness=roughness,
        dielectric=finger.dielectric.model_copy(
            update={"scale": fit.best("skin_dielectric_scale")}
        ),
    )


def instruments_of(recordings: Iterable[StrokeRecording]) -> list[str]:
    """Names and serial numbers that occur, sorted."""
    return sorted(
        {
            f"{name}: {serial}"
            for recording in recordings
            for name, serial in recording.conditions.instruments.items()
        }
    )


def write_archive(folder: Path, path: Path) -> None:
    """Pack a session's folder, raw recordings included, into one zip file."""
    files = [file for file in sorted(folder.rglob("*")) if file.is_file() and file != path]

    def pack(draft: Path) -> None:
        with zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED) as archive:
            for file in files:
                archive.write(file, file.relative_to(folder.parent))

    write_whole(path, pack)
