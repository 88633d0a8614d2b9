"""The oracle of the firmware has the calls of the core, so that a mock plays by either."""

from typing import Any, cast

import numpy as np

from firmware_io import Device, MockDriver
from firmware_io.firmware.core import Core
from firmware_io.links.mock import MockLink
from tests.firmware_io.oracle.device import Oracle


def test_it_has_the_calls_of_the_core():
    calls = {name for name in vars(Core) if not name.startswith("_")}
    # The oracle has no memory that goes bad, no output to read back, and no converter.
    assert calls - {"is_whole", "read_back", "test_itself", "sense"} <= set(vars(Oracle))


def test_a_mock_plays_an_envelope_alike_by_either():
    volts = np.linspace(0.0, 30.0, 400)
    outputs = []
    for is_oracle in (False, True):
        driver = MockDriver()
        if is_oracle:
            cast(Any, driver).core = Oracle(driver.about)
        with Device(MockLink(driver, 64), sample_rate_hz=8000) as device:
            device.write(volts)
        outputs.append(device.mock.output)
    for ours, theirs in zip(*outputs, strict=True):
        np.testing.assert_array_equal(ours, theirs)
