"""Which finger goes with which screen: a calibrated screen has the one that was measured with it.

A calibration writes ``screen.toml`` and ``finger.toml`` into one folder, and their numbers belong
together: with another finger, friction is wrong by a just-noticeable difference or more.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path

from haptix.base.errors import InputError
from haptix.model.finger import Finger
from haptix.model.screen import CalibrationWarning, Screen

SCREEN, FINGER = "screen.toml", "finger.toml"
"""Names of the two profiles in the folder of a calibration."""


def finger_beside(screen: str | Path, folder: Path = Path()) -> str | None:
    """Return the file of the finger that was measured with a calibrated screen.

    None for presets, and for screens that are not calibrated. Raises `InputError` if there is no
    such file, or it has another finger.
    """
    if not str(screen).endswith(".toml"):
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CalibrationWarning)  # comes where the screen is used
        profile = Screen.load(folder / screen)
    if profile.calibration is None:
        return None
    beside = Path(screen).with_name(FINGER)
    if not (folder / beside).exists():
        raise InputError(
            f"expected a finger: screen {profile.name!r} is calibrated, and there is no {beside} "
            "of the same calibration; put it there, or name a finger"
        )
    check_measured_with(profile, Finger.load(folder / beside), beside)
    return str(beside)


def profile_names(finger: str | None, screen: str | None) -> tuple[str, str]:
    """Return names or files of finger and screen: as given, beside the screen, or presets."""
    screen = screen or "3m-sct3250"
    return finger or finger_beside(screen) or "semi-wet", screen


def profiles(finger: str | None, screen: str | None) -> tuple[Finger, Screen]:
    """Load what `profile_names` finds."""
    names = profile_names(finger, screen)
    return Finger.named(names[0]), Screen.named(names[1])


def check_measured_with(screen: Screen, finger: Finger, file: str | Path) -> None:
    """Raise `InputError` unless a finger is the one that was measured with a calibrated screen."""
    known = "" if screen.calibration is None else screen.calibration.finger_hash
    if known and finger.content_hash() != known:
        raise InputError(
            f"{file} is not the finger that was measured with screen {screen.name!r}, or was "
            "edited: take the finger.toml of the same calibration"
        )


def described(finger: Finger, screen: Screen) -> dict[str, str]:
    """Return the names of finger and screen, whether they were measured together, and the range.

    The range is that in which the screen's calibration was verified, where its profile states one.
    """
    calibration = screen.calibration
    if calibration is None:
        pair = "screen not measured"
    elif not calibration.finger_hash:
        pair = "screen measured with a finger that its profile does not name"
    elif calibration.finger_hash != finger.content_hash():
        pair = "screen measured with another finger"
    else:
        pair = "measured together"
    if calibration is not None and calibration.is_virtual:
        pair += "; virtual"
    about = {"finger": finger.name, "screen": screen.name, "pair": pair}
    return about if screen.verified is None else {**about, "verified": screen.verified.text}


def first_line(about: Mapping[str, str]) -> str:
    """Return the first line of an output for people, from what `described` returns."""
    line = f"finger {about['finger']!r}, screen {about['screen']!r} ({about['pair']})"
    return f"{line}; verified for {about['verified']}" if "verified" in about else line
