"""Possible boards: the ranges of hx_config and the constants of haptix_device.h."""

from __future__ import annotations

from firmware_io.device_errors import DeviceError
from firmware_io.firmware.core import Sensor
from firmware_io.protocol import FULL_SCALE_CODE, CapabilitiesReport

QUEUE_SAMPLES = 1 << 17
FRAME_SAMPLES = 32765
RAMP_MS = 5
MIN_WATCHDOG_MS = 10
PAUSE_MS = 100
DRY_MS = 10
MAX_WATCHDOG_MS = 160
MIN_CARRIER_MHZ = 1_000_000
ABSOLUTE_CEILING_MV = 200_000
ABSOLUTE_SLEW_V_PER_S = 4_666_666
MAX_REPORT_BYTES = 64
SENSE_RATES_HZ = (250, 500, 1000, 2000, 4000)


def ceiling_code(config: CapabilitiesReport, ceiling_mv: int) -> int:
    """Return the highest code under a ceiling."""
    return min(ceiling_mv * FULL_SCALE_CODE // config.full_scale_mv, FULL_SCALE_CODE)


def lowest_slew(config: CapabilitiesReport, ceiling_mv: int) -> int:
    """Return the least slew in V/s that the safety ramp from a ceiling keeps."""
    ramp_ticks = -(-config.output_rate_hz * RAMP_MS // 1000)
    step_codes = -(-ceiling_code(config, ceiling_mv) // ramp_ticks)
    codes_per_s = step_codes * config.output_rate_hz
    return max(1, -(-codes_per_s * config.full_scale_mv // (1000 * FULL_SCALE_CODE)))


def check_board(config: CapabilitiesReport, sensor: Sensor) -> None:
    """Raise DeviceError unless all values lie in the ranges of hx_config."""
    senses = config.sense_rate_hz == 0 or (
        config.sense_rate_hz in SENSE_RATES_HZ
        and 100_000 <= round(sensor.full_scale_a * 1e9) <= 50_000_000
        and 100 <= round(sensor.panel_f * 1e12) <= 100_000
    )
    rates_are_possible = 1 <= len(config.rates) <= 8 and all(
        rate.sample_rate_hz > 0
        and config.output_rate_hz % rate.sample_rate_hz == 0
        and config.output_rate_hz // rate.sample_rate_hz <= 1024
        and rate.modes
        for rate in config.rates
    )
    texts = (config.name, config.serial, config.calibration_id)
    is_possible = (
        1000 <= config.output_rate_hz <= 1_000_000
        and 1 <= config.full_scale_mv <= 1_000_000
        and 1 <= config.ceiling_mv <= ABSOLUTE_CEILING_MV
        and lowest_slew(config, config.ceiling_mv) <= config.max_slew_v_per_s
        and config.max_slew_v_per_s <= ABSOLUTE_SLEW_V_PER_S
        and 1 <= config.max_frame_samples <= min(FRAME_SAMPLES, config.queue_samples)
        and config.queue_samples <= QUEUE_SAMPLES
        and MIN_WATCHDOG_MS <= config.max_watchdog_ms <= MAX_WATCHDOG_MS
        and (config.report_bytes == 0 or 8 <= config.report_bytes <= MAX_REPORT_BYTES)
        and 1 <= config.guard_ticks <= 65535
        and rates_are_possible
        and senses
        and all(len(text) <= 16 and text.isascii() for text in texts)
    )
    if not is_possible:
        raise DeviceError(
            f"Impossible values, see hx_config for the ranges: {config}; correct them."
        )
