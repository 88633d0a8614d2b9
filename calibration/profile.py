"""The screen profile: what a calibration leaves behind, and every later session starts from."""

from __future__ import annotations

from pathlib import Path

from haptix.errors import InputError
from haptix.screen import Screen


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
    if screen.name.strip() in ("", "custom"):
        raise InputError(
            f"expected a screen with a name of its own, got {screen.name!r}: use "
            'screen.replace(name="...") so that outputs can say which screen they are for'
        )
    path = Path(path)
    if path.exists() and not overwrite:
        raise InputError(f"{path} exists: pass overwrite=True to replace that calibration")
    screen.save(path)
