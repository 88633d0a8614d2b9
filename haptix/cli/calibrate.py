"""``haptix calibrate``: the steps of the calibration room, which runs by itself as well."""

from calibration.app import app

__all__ = ["app"]
