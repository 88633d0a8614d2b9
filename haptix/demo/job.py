"""The main job: photograph, surface, finger, renderer, mock driver, and the folder it leaves."""

from __future__ import annotations

import json
import shutil
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import soundfile

from firmware_io import Device, open_device
from firmware_io.mock import MockDriver
from haptix.demo.figure import draw
from haptix.demo.judge import Outcome, friction_figures, judge
from haptix.errors import InputError
from haptix.finger import Finger
from haptix.friction import ContactModel
from haptix.motion import Trajectory
from haptix.render import Renderer, RenderSettings, RenderStats, SineCarrier
from haptix.screen import Screen
from haptix.surface import FrictionSurface, cached_surface
from haptix.texture import Texture
from haptix.version import __version__

Progress = Callable[[str, float], None]

FINGER_PATH = Path(__file__).parent / "finger_path.csv"
"""The path of a finger that ships with the demo."""

_OUTPUTS = ("drive.wav", "drive.json", "summary.json", "demo.png")
_LEAST_PERIODS = 10
_TOLERANCE = 5e-4  # of the surface, in mu; at mu = 0.27 a sixtieth of what is felt


@dataclass(frozen=True)
class DemoResult:
    """What the job left behind."""

    folder: Path
    summary: dict[str, Any]


@dataclass(frozen=True)
class DemoJob:
    """A photograph under a moving finger, on the mock driver.

    Parameters
    ----------
    folder : Path
        Where the outputs go; made if needed.
    image : Path, optional
        Photograph; scikit-image's CC0 brick wall without one.
    trajectory : Path, optional
        CSV with t_s, x_mm, y_mm, normal_force_n; `FINGER_PATH` without one.
    width_mm : float
        Width of the photograph on the screen.
    polarity : {"bright-high", "dark-high"}
        Which end of the grey scale has the higher friction.
    finger, screen : str
        Presets.
    carrier_hz : float
        Frequency of the drive.
    mu_range : (float, float), optional
        Friction coefficients wanted where the photograph is lowest and highest; without it they
        are the ends of the range that is reachable at the finger's force.
    """

    folder: Path
    image: Path | None = None
    trajectory: Path | None = None
    width_mm: float = 60.0
    polarity: str = "bright-high"
    finger: str = "semi-wet"
    screen: str = "3m-sct3250"
    carrier_hz: float = 4000.0
    mu_range: tuple[float, float] | None = None

    def run(self, on_progress: Progress = lambda stage, share: None) -> DemoResult:
        """Do the job and write its folder.

        Raises
        ------
        HaptixError
            If an input cannot be used or the folder not written; no output has changed then.
        """
        self._check_folder()
        path = Trajectory.from_csv(self.trajectory or FINGER_PATH)
        device = open_device("mock:")
        self._check_carrier(path, device)
        texture = self._texture()
        model = ContactModel(Finger.preset(self.finger), Screen.preset(self.screen))

        began = time.perf_counter()
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
        renderer, driver = _play(surface, texture, path, device, on_progress)
        rendered = time.perf_counter()
        outcome = judge(model, surface, path, renderer, driver)
        on_progress("judge", 1.0)

        summary = {
            "haptix": __version__,
            "photograph": str(self.image or "scikit-image brick (CC0)"),
            "width_mm": self.width_mm,
            "polarity": self.polarity,
            "mu_range": self.mu_range,
            "finger": self.finger,
            "screen": self.screen,
            "stand_ins": model.placeholders(),
            "friction": friction_figures(outcome),
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
                "frames_sent": device.frames_sent,
                "bytes_sent": device.bytes_sent,
                "samples_played": driver.samples_played,
                "underruns": driver.underruns,
                "faults": driver.faults,
            },
            "seconds": {
                "surface": round(built - began, 3),
                "rendering": round(rendered - built, 3),
            },
        }
        self._write(model, surface, texture, path, device, outcome, summary)
        on_progress("write", 1.0)
        return DemoResult(self.folder, summary)

    def _check_folder(self) -> None:
        if self.folder.exists() and not self.folder.is_dir():
            raise InputError(f"--out: {self.folder} is a file; name a folder")
        for name in _OUTPUTS:
            if (self.folder / name).is_dir():
                raise InputError(f"--out: {self.folder / name} is a folder; name another --out")

    def _check_carrier(self, path: Trajectory, device: Device) -> None:
        carrier = SineCarrier(self.carrier_hz)
        carrier.check_rate(device.capabilities.sample_rate_hz)
        if path.duration_s * carrier.frequency_hz < _LEAST_PERIODS:
            raise InputError(
                f"trajectory: expected {_LEAST_PERIODS} periods or more of the "
                f"{self.carrier_hz:g} Hz carrier, got {path.duration_s:g} s; give a longer path or "
                "a higher carrier"
            )

    def _texture(self) -> Texture:
        image: Any = self.image
        if image is None:
            from skimage.data import brick

            image = brick()
        return Texture.from_image(
            image,
            self.width_mm,
            self.polarity,  # type: ignore[arg-type]  # checked there
            self.mu_range,
        )

    def _write(
        self,
        model: ContactModel,
        surface: FrictionSurface,
        texture: Texture,
        path: Trajectory,
        device: Device,
        outcome: Outcome,
        summary: Mapping[str, Any],
    ) -> None:
        """Write everything beside the folder first, then move it there."""
        reach, driver = device.capabilities, device.mock
        assert driver is not None  # "mock:" has one
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
        drafts: Path | None = None
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            drafts = Path(tempfile.mkdtemp(dir=self.folder, prefix=".draft-"))
            # 16-bit samples are the codes that went over the wire: the file is what was played.
            rate = round(reach.sample_rate_hz)
            soundfile.write(drafts / "drive.wav", driver.played_codes, rate, "PCM_16")
            _write_json(drafts / "drive.json", sidecar)
            _write_json(drafts / "summary.json", summary)
            draw(
                drafts / "demo.png",
                texture,
                path,
                outcome,
                driver.played_v,
                reach.sample_rate_hz,
                surface.voltage_limit_v,
                bright_is_high=self.polarity == "bright-high",
            )
            for name in _OUTPUTS:
                (drafts / name).replace(self.folder / name)
        except (OSError, soundfile.SoundFileError) as error:
            raise InputError(f"--out: cannot write to {self.folder}: {error}") from None
        finally:
            if drafts is not None:
                shutil.rmtree(drafts, ignore_errors=True)


def _play(
    surface: FrictionSurface,
    texture: Texture,
    path: Trajectory,
    device: Device,
    on_progress: Progress,
) -> tuple[Renderer, MockDriver]:
    driver = device.mock
    assert driver is not None  # "mock:" has one
    settings = RenderSettings(keep_blocks=True)
    with Renderer(surface, texture, device, settings=settings) as renderer:
        touches = zip(path.t_s, path.x_mm, path.y_mm, path.normal_force_n, strict=True)
        for number, touch in enumerate(touches, start=1):
            renderer.touch(*touch)
            on_progress("render", number / len(path.t_s))
    device.close()
    return renderer, driver


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


def _write_json(path: Path, value: Any) -> None:
    path.write_text(json.dumps(value, indent=2, allow_nan=False) + "\n", encoding="utf-8")
