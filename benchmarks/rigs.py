"""Rigs that measure badly in known ways, for calibrations with known truth.

Nothing here is used by a fit, and nothing of haptix is used here: a rig turns what a finger felt
into what a laboratory's instruments would have written down.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from independent_finger import Felt
from scipy.fft import next_fast_len

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Rig:
    """Faults of a force sensor and of what stands around it; all forces in N."""

    noise_n: float = 2e-3
    offset_n: float = 5e-3
    drift_n_per_s: float = 2e-3
    crosstalk: float = 0.0
    hum_n: float = 0.0
    stick_slip: float = 0.0
    latency_s: float = 0.0
    bits: int = 24
    pole_hz: float = np.inf
    resonance_hz: float = np.inf
    quality: float = 10.0
    normal_gain: float = 1.0
    tangential_gain: float = 1.0
    creep: float = 0.0
    """Rise of the friction within a second of contact, relative."""
    drying: float = 0.0
    """Rise of the friction from the first stroke to the last, relative."""
    full_scale_n: float = 5.0

    def read(self, felt: Felt, seed: int, session_share: float = 0.0) -> dict[str, Array]:
        """Signals of one stroke, at a share of the session's time."""
        rng = np.random.default_rng(seed)
        t = felt.t_s - felt.t_s[0]
        sign = np.sign(np.gradient(felt.x_mm))
        touched = np.cumsum(felt.normal_force_n > 0.02) * (t[1] - t[0])
        slip = 1 + self.stick_slip * _sawtooth(t, rng)
        grown = (1 + self.creep * np.log1p(touched / 0.1) / np.log1p(10.0)) * slip
        drag = sign * felt.friction_force_n * grown * (1 + self.drying * session_share)
        press = felt.normal_force_n
        hum = sum(
            share * np.sin(2 * np.pi * 50 * k * t + rng.uniform(0, 2 * np.pi))
            for k, share in ((1, 1.0), (3, 0.3), (5, 0.2))
        )
        found = []
        for own, other, gain in (
            (drag, press, self.tangential_gain),
            (press, drag, self.normal_gain),
        ):
            clean = self._filtered(gain * own + self.crosstalk * other, t[1] - t[0])
            drift = self.offset_n + self.drift_n_per_s * t * rng.uniform(-1, 1)
            noisy = clean + drift + self.hum_n * hum + rng.normal(0, self.noise_n, len(t))
            step = 2 * self.full_scale_n / 2**self.bits
            found.append(np.rint(noisy / step) * step)
        return {
            "t_s": felt.t_s,
            "normal_force_n": found[1],
            "tangential_force_n": found[0],
            "x_mm": felt.x_mm,
            "drive_v": felt.drive_v,
        }

    def _filtered(self, force: Array, step_s: float) -> Array:
        count = next_fast_len(len(force), real=True)
        hertz = np.fft.rfftfreq(count, step_s)
        return np.fft.irfft(np.fft.rfft(force, count) * self.gain(hertz), count)[: len(force)]

    def gain(self, hertz: Array) -> npt.NDArray[np.complex128]:
        """Complex gain of either axis."""
        ratio = hertz / self.resonance_hz
        slow = 1 / (1 + 1j * hertz / self.pole_hz)
        return (
            slow
            / (1 - ratio**2 + 1j * ratio / self.quality)
            * np.exp(-2j * np.pi * hertz * self.latency_s)
        )


def _sawtooth(t: Array, rng: np.random.Generator) -> Array:
    """Stick-slip: a slow rise and a quick fall, at a rate that wanders; mean 0, amplitude 1."""
    rate = rng.uniform(25, 60) * (1 + 0.2 * np.sin(2 * np.pi * rng.uniform(1, 3) * t))
    phase = np.cumsum(rate) * (t[1] - t[0]) % 1.0
    return 2 * phase - 1


REALISTIC = {
    "noise_n": 5e-3, "drift_n_per_s": 5e-3, "crosstalk": 0.02, "hum_n": 5e-3,
    "stick_slip": 0.05, "latency_s": 1.5e-3, "bits": 16,
}  # fmt: skip
RIGS: Mapping[str, Rig] = {
    "clean": Rig(),
    "realistic": Rig(**REALISTIC),
    "pole 3 kHz": Rig(**REALISTIC, pole_hz=3000.0),
    "pole 1 kHz": Rig(**REALISTIC, pole_hz=1000.0),
    "pole 500 Hz": Rig(**REALISTIC, pole_hz=500.0),
    "resonance": Rig(**REALISTIC, resonance_hz=1200.0),
    "drying 3 %": Rig(**REALISTIC, drying=0.03),
    "creep 5 %": Rig(**REALISTIC, creep=0.05),
}
BROKEN: Mapping[str, Rig] = {
    "tangential x 1.1": Rig(**REALISTIC, tangential_gain=1.1),
    "normal x 0.9": Rig(**REALISTIC, normal_gain=0.9),
    "drying 30 %": Rig(**REALISTIC, drying=0.3),
    "stick-slip 40 %": Rig(**{**REALISTIC, "stick_slip": 0.4}),
}
