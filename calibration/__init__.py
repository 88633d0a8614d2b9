"""Calibration of one screen: from recordings to a profile that `haptix.Screen.load` reads."""

from calibration.profile import write_screen_profile

__all__ = ["write_screen_profile"]
