"""``python -m calibration``: the same as ``haptix calibrate``."""

from calibration.app import main

main()
