"""A straight stroke over the screen."""

import numpy as np
import pytest


@pytest.fixture(scope="session")
def stroke():
    """Return a path of constant speed and force, as the arguments of `feel`."""

    def at(duration_s, speed_mm_per_s=50.0, normal_force_n=0.5, start_s=0.0):
        time = np.array([start_s, start_s + duration_s])
        return {
            "t_s": time,
            "x_mm": speed_mm_per_s * (time - start_s),
            "y_mm": 10.0,
            "normal_force_n": normal_force_n,
        }

    return at
