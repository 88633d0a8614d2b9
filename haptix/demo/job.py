"""Run the main job and judge it by what the mock driver played."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import soundfile
import torch

from firmware_io import Device, open_device
from firmware_io.mock import MockDriver
from haptix.demo.figure import draw
from haptix.errors import InputError
from haptix.finger import Finger
from haptix.friction import ContactModel
from haptix.render import Carrier, Renderer, RenderStats, Trajectory
from haptix.screen import Screen
from haptix.surface import FrictionSurface, cached_surface
from haptix.texture import Texture
from haptix.version import __version__

Array = npt.NDArray[np.float64]
Progress = Callable[[str, float], None]

FINGER_PATH = Path(__file__).parent / "finger_path.csv"
WEBER_FRACTION = 0.11
"""Smallest relative change of friction that is felt (Gueorguiev et al. 2017)."""

_LEAST_PERIODS = 10
_TOLERANCE = 5e-4  # of the surface, in mu: a sixtieth of what is felt


@dataclass(frozen=True)
class Outcome:
    """Friction along the path, at the middle of every carrier period."""

    t_s: Array
    target_mu: Array
    reached_mu: Array
    amplitude_v: Array
    lowest_mu: Array
    highest_mu: Array


@dataclass(frozen=True)
class DemoResult:
    """What the job left behind."""

    folder: Path
    summary: dict[str, Any]


@dataclass(frozen=True)
class DemoJob:
    """A photograph under a moving finger, on the mock driver.

    Everything is read and checked on construction or before the first file is written.

    Parameters
    ----------
    folder : Path
        Where the outputs go; made if needed.
    image : Path, optional
        Photograph; scikit-image's CC0 brick wall without one.
    trajectory : Path, optional
        CSV with t_s, x_mm, y_mm, normal_force_n.
    width_mm : float
        Width of the photograph on the screen.
    polarity : {"bright-high", "dark-high"}
        Which end of the grey scale has the higher friction.
    finger, screen : str
        Presets.
    carrier_hz : float
        Frequency of the drive.
    """

    folder: Path
    image: Path | None = None
    trajectory: Path | None = None
    width_mm: float = 60.0
    polarity: str = "bright-high"
    finger: str = "semi-wet"
    screen: str = "3m-sct3250"
    carrier_hz: float = 4000.0

    def run(self, on_progress: Progress = lambda stage, share: None) -> DemoResult:
        """Do the job and write its folder.

        Raises
        ------
        HaptixError
            If an input cannot be used; nothing is written then.
        """
        if self.folder.exists() and not self.folder.is_dir():
            raise InputError(f"--out: {self.folder} is a file; name a folder")
        began = time.perf_counter()
        path = Trajectory.from_csv(self.trajectory or FINGER_PATH)
        device = open_device("mock:")
        Carrier(
            self.carrier_hz, device.capabilities.sample_rate_hz
        )  # or say why not, before the work
        if path.duration_s * self.carrier_hz < _LEAST_PERIODS:
            raise InputError(
                f"trajectory: expected {_LEAST_PERIODS} periods or more of the "
                f"{self.carrier_hz:g} Hz carrier, got {path.duration_s:g} s; give a longer path or "
                "a higher carrier"
            )
        texture = self._texture()
        model = ContactModel(Finger.preset(self.finger), Screen.preset(self.screen))
        force = path.normal_force_n
        scene = {
            "normal_force_n": (float(force.min()), float(force.max())),
            "frequency_hz": self.carrier_hz,
        }
        surface, was_cached = cached_surface(
            model, scene, _TOLERANCE, lambda share: on_progress("surface", share)
        )
        on_progress("surface", 1.0)
        built = time.perf_counter()
        driver, renderer, bytes_sent, frames_sent = _play(
            surface, texture, path, device, on_progress
        )
        rendered = time.perf_counter()
        outcome = _judge(model, texture, path, renderer, driver)
        on_progress("judge", 1.0)
        summary = {
            "haptix": __version__,
            "photograph": str(self.image or "scikit-image brick (CC0)"),
            "width_mm": self.width_mm,
            "polarity": self.polarity,
            "finger": self.finger,
            "screen": self.screen,
            "stand_ins": _stand_ins(model),
            "friction": _friction_figures(outcome),
            "out_of_range": _out_of_range(renderer.stats),
            "surface": {
                "grid": list(surface.mu_table.shape),
                "error_max_mu": surface.info["error_max"],
                "error_p99_mu": surface.info["error_p99"],
                "key": surface.info["key"],
                "from_cache": was_cached,
            },
            "stream": {
                **_block_figures(renderer.stats, path.duration_s),
                "frames_sent": frames_sent,
                "bytes_sent": bytes_sent,
                "samples_played": driver.samples_played,
                "underruns": driver.underruns,
                "faults": driver.faults,
            },
            "seconds": {
                "surface": round(built - began, 3),
                "rendering": round(rendered - built, 3),
            },
        }
        self._write(model, surface, texture, path, driver, outcome, summary)
        on_progress("write", 1.0)
        return DemoResult(self.folder, summary)

    def _texture(self) -> Texture:
        image: Any = self.image
        if image is None:
            from skimage.data import brick

            image = brick()
        return Texture.from_image(image, self.width_mm, self.polarity)  # type: ignore[arg-type]

    def _write(
        self,
        model: ContactModel,
        surface: FrictionSurface,
        texture: Texture,
        path: Trajectory,
        driver: MockDriver,
        outcome: Outcome,
        summary: Mapping[str, Any],
    ) -> None:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"--out: cannot make {self.folder}: {error.strerror}") from None
        reach = driver.capabilities
        # 16-bit samples are the codes that went over the wire: the file is what was played.
        soundfile.write(
            self.folder / "drive.wav", driver.played_codes, round(reach.sample_rate_hz), "PCM_16"
        )
        sidecar = {
            "what": "drive signal as the mock driver played it",
            "volts": "sample / 32767 * full_scale_v",
            "full_scale_v": reach.full_scale_v,
            "sample_rate_hz": reach.sample_rate_hz,
            "carrier_hz": self.carrier_hz,
            "voltage_limit_v": surface.voltage_limit_v,
            "surface_key": surface.info["key"],
            "model": model.describe(),
        }
        _write_json(self.folder / "drive.json", sidecar)
        _write_json(self.folder / "summary.json", summary)
        draw(
            self.folder / "demo.png",
            texture,
            path,
            outcome,
            driver.played_v,
            reach.sample_rate_hz,
            surface.voltage_limit_v,
            bright_is_high=self.polarity == "bright-high",
        )


def _play(
    surface: FrictionSurface,
    texture: Texture,
    path: Trajectory,
    device: Device,
    on_progress: Progress,
) -> tuple[MockDriver, Renderer, int, int]:
    driver = device.mock
    assert driver is not None  # "mock:" has one
    with Renderer(surface, texture, device) as renderer:
        touches = zip(path.t_s, path.x_mm, path.y_mm, path.normal_force_n, strict=True)
        for number, touch in enumerate(touches, start=1):
            renderer.touch(*touch)
            on_progress("render", number / len(path.t_s))
    device.close()
    return driver, renderer, device.bytes_sent, device.frames_sent


def _judge(
    model: ContactModel,
    texture: Texture,
    path: Trajectory,
    renderer: Renderer,
    driver: MockDriver,
) -> Outcome:
    """Friction from the contact model itself, for the amplitude that was really played."""
    sample, amplitude = renderer.carrier.demodulate(driver.played_v[: renderer.stats.samples])
    t = path.t_s[0] + sample / renderer.carrier.sample_rate_hz
    x, y, force = path.at(t)
    load = torch.from_numpy(force)
    limit = model.screen.max_voltage_v
    # Rounding to 16 bits may read back a millivolt above the limit, and never below zero.
    amplitude = amplitude.clip(0.0, limit)
    frequency = renderer.carrier.frequency_hz
    reached, lowest, highest = (
        model.solve(load, torch.as_tensor(voltage), frequency).mu.numpy()
        for voltage in (amplitude, 0.0, limit)
    )
    wanted = texture.friction(x, y)
    return Outcome(t, lowest + wanted * (highest - lowest), reached, amplitude, lowest, highest)


def _friction_figures(outcome: Outcome) -> dict[str, float]:
    # One period of the carrier at each end sees the ramp; every other one counts.
    error = np.abs(outcome.reached_mu - outcome.target_mu)[1:-1]
    threshold = WEBER_FRACTION * outcome.target_mu[1:-1]
    return {
        "target_mu_min": float(outcome.target_mu.min()),
        "target_mu_max": float(outcome.target_mu.max()),
        "error_rms_mu": float(np.sqrt(np.mean(error**2))),
        "error_p95_mu": float(np.percentile(error, 95)),
        "error_max_mu": float(error.max()),
        "error_p95_difference_thresholds": float(np.percentile(error / threshold, 95)),
    }


def _out_of_range(stats: RenderStats) -> dict[str, float]:
    return {
        "share_below": stats.below / stats.samples,
        "share_above": stats.above / stats.samples,
        "share_outside_surface": stats.outside / stats.samples,
    }


def _block_figures(stats: RenderStats, duration_s: float) -> dict[str, float]:
    block_ms = np.asarray(stats.block_s) * 1e3
    return {
        "blocks": len(block_ms),
        "block_length_ms": duration_s * 1e3 / len(block_ms),
        "block_time_median_ms": float(np.median(block_ms)),
        "block_time_p99_ms": float(np.percentile(block_ms, 99)),
    }


def _stand_ins(model: ContactModel) -> list[str]:
    finger = model.finger
    stand_ins = []
    if finger.roughness.is_placeholder:
        stand_ins.append("roughness spectrum of the finger")
    if finger.dielectric.is_placeholder:
        stand_ins.append("dielectric of the skin")
    return stand_ins


def _write_json(path: Path, value: Any) -> None:
    path.write_text(json.dumps(value, indent=2) + "\n", encoding="utf-8")
