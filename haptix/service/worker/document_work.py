"""Documents and files of clients, as a worker checks, draws and exports them.

A worker decodes, draws, checks and exports: questions of the front come in as calls of
`DocumentWork`, answers go out as values for JSON.
"""

from __future__ import annotations

import base64
from datetime import UTC, date, datetime
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import BaseModel

from haptix.base.errors import InputError
from haptix.base.task import Context, task_at
from haptix.feel.materials.decoded import PICTURES
from haptix.model.presets import DEFAULT_CARRIER_HZ, FORCES_N

if TYPE_CHECKING:
    from haptix.feel.materials import Material
    from haptix.model.finger import Finger
    from haptix.model.screen import Screen
    from haptix.model.surface import FrictionSurface

EXPORT = "haptix.tasks.materials:ExportLayout"
"""The task that writes layouts in forms of interchange."""
_FORCES_N = (0.1, 0.2, 0.5, 1.0, 2.0, 3.0)
FORCE_N = 0.5
"""Where a request has no other."""
MOST_SAMPLES, MOST_TABLE_BYTES = 48_000 * 60, 2_000_000
"""Of a sound, and of a table or model, which the engine reads in a second or two."""

"""Forces [N] of the surface that is built where none is given: all that a finger slides with."""
_TOLERANCE = "0.05 JND"


class DocumentWork:
    """The questions that a worker answers, one method each.

    Parameters
    ----------
    assets : Path
        Folder of the files that apps have sent; documents read nothing else.
    opening : dict
        Finger and screen, as the engine has them, and the file of its surface if it was given one.
    """

    def __init__(self, assets: Path, opening: dict[str, Any]) -> None:
        self._assets, self._opening = assets, opening
        self._currents = lru_cache(4)(self._solve_currents)

    def picture(
        self,
        material: dict[str, Any],
        width_mm: float,
        height_mm: float,
        columns: int,
        t_s: float,
        reachable_mu: tuple[float, float],
        frames: int = 1,
        frame_s: float = 0.05,
    ) -> dict[str, Any]:
        """Shares of the reachable friction on a grid, with how much of it is out of reach."""
        from haptix.feel.materials import as_mu
        from haptix.feel.materials.picture import picture

        parsed = self.read(material)
        times = t_s + frame_s * np.arange(frames)
        wanted = np.stack([picture(parsed, width_mm, height_mm, columns, t) for t in times])
        low, high = reachable_mu
        share = (as_mu(parsed.evaluator.target, wanted, low, high) - low) / max(high - low, 1e-9)
        _, rows, columns = share.shape
        # One byte a place: 255 steps from half a range below to half a range above the range.
        level = np.clip(np.rint((share + 0.5) * 127.5), 0, 255).astype(np.uint8)
        return {
            "columns": columns,
            "rows": rows,
            "levels": base64.b64encode(level.tobytes()).decode(),
            "below": float((share < -0.005).mean()),
            "above": float((share > 1.005).mean()),
            "lowest_mu": low,
            "highest_mu": high,
        }

    def check(self, material: dict[str, Any], reachable_mu: tuple[float, float]) -> dict[str, Any]:
        """All fields of a document, its range, and the effect of a step of each [JND]."""
        from haptix.feel.materials.panels import effects_of_steps
        from haptix.model.perception.thresholds import WEBER_FRACTION

        parsed = self.read(material)
        low, high = reachable_mu
        return {
            "canonical": parsed.model_dump(mode="json", exclude_none=True),
            "target": parsed.evaluator.target,
            "depends_on": [str(flag.name).lower() for flag in parsed.evaluator.depends_on],
            "lowest_mu": low,
            "highest_mu": high,
            "range_jnd": (high - low) / (WEBER_FRACTION * low),
            "effects_jnd": effects_of_steps(parsed, low, high),
        }

    def decode(self, digest: str) -> dict[str, Any]:
        """Check a file for the engine, which decodes no picture.

        The pixels of a picture are kept. Other files must be short: the engine reads them itself.
        """
        path = next(iter(self._assets.glob(f"{digest}.*")))
        if path.suffix in PICTURES:
            from haptix.feel.materials.pictures import read_pixels

            read_pixels("image", path)
            return {}
        with path.open("rb") as file:
            head = file.read(4)
        if head in (b"RIFF", b"fLaC"):
            from haptix.feel.signals.audio_files import count_samples

            count = count_samples(path)
            if count > MOST_SAMPLES:
                raise InputError(
                    f"file: expected a sound of at most {MOST_SAMPLES} samples, a minute at 48 kHz,"
                    f" got {count}"
                )
            return {}
        size = path.stat().st_size
        if size > MOST_TABLE_BYTES:
            raise InputError(
                f"file: expected a table or model of at most {MOST_TABLE_BYTES / 1e6:g} MB, got "
                f"{size / 1e6:.3g} MB; thin it out"
            )
        return {}

    def export(self, **fields: Any) -> dict[str, Any]:
        """Return a layout in a form of interchange, as an archive of files; see the task."""
        from haptix.base.kinds import in_folder

        task = task_at(EXPORT)(
            **fields,
            finger=self._opening["finger"],
            screen=self._opening["screen"],
            surface=self._opening.get("surface"),
        )
        with in_folder(self._assets, is_sealed=True):
            result = task.run(Context(self._assets))
        return {"content": base64.b64encode(result.files["layout.zip"]).decode()}

    def currents(self, carrier_hz: float, highest_v: float) -> dict[str, Any]:
        """Amplitudes of the current through a finger, at several forces."""
        return self._currents(carrier_hz, highest_v)

    def read(self, document: dict[str, Any]) -> Material:
        """Read a document, whose files are those of the service."""
        from haptix.base.kinds import in_folder
        from haptix.feel.materials import material_of

        with in_folder(self._assets, is_sealed=True):
            parsed = material_of(document)
            if parsed.evaluator.target not in ("share", "mu", "contrast"):
                raise InputError(f"target: expected a friction, got {parsed.evaluator.target}")
            return parsed

    def _solve_currents(self, carrier_hz: float, highest_v: float) -> dict[str, Any]:
        from haptix.model.finger import Finger
        from haptix.model.friction import ContactModel
        from haptix.model.screen import Screen

        finger, screen = (self._opening[name] for name in ("finger", "screen"))
        model = ContactModel(Finger.named(finger), Screen.named(screen))
        state = model.solve(
            normal_force_n=list(_FORCES_N), voltage_v=highest_v, frequency_hz=carrier_hz
        )
        assert state.current_a is not None  # there is a frequency
        return {"normal_force_n": list(_FORCES_N), "current_a": state.current_a.tolist()}


def surface_of(opening: dict[str, Any]) -> FrictionSurface:
    """Load the surface that was given, or load or build one for finger, screen and device."""
    from haptix.model.finger import Finger
    from haptix.model.friction import ContactModel
    from haptix.model.screen import Screen
    from haptix.model.surface import FrictionSurface, cached_surface

    if opening["surface"] is not None:
        return FrictionSurface.load(opening["surface"])
    model = ContactModel(Finger.named(opening["finger"]), Screen.named(opening["screen"]))
    scene = {"normal_force_n": FORCES_N, "frequency_hz": DEFAULT_CARRIER_HZ}
    surface, _ = cached_surface(model, scene, _TOLERANCE)
    return surface.limited(opening.get("ceiling_v", surface.voltage_limit_v))


class Profile(BaseModel):
    """A profile in use."""

    name: str
    source: str
    """Its file, or "preset"."""
    calibrated: date | None = None
    """Date of the measurement; None for values not measured on this very screen."""
    age_days: int | None = None
    verdict: str = ""
    rests_on: tuple[str, ...] = ()
    """Values that were assumed and not measured."""
    spread: dict[str, float] = {}
    """Standard deviation of the logarithm of each number that was found."""
    warnings: tuple[str, ...]
    """Reasons not to trust it."""
    verified: str = ""
    """Range in which a calibration has verified it; empty where none has."""
    document: dict[str, Any]


def profiles_of(finger: Finger, screen: Screen, sources: dict[str, str]) -> dict[str, Any]:
    """Return the profiles as the service gives them out, by kind.

    Parameters
    ----------
    finger, screen : Finger, Screen
        The profiles in use.
    sources : dict of str
        Preset or file of each, by kind.
    """
    calibration = screen.calibration
    measured: dict[str, Any] = {}
    if calibration is not None:
        age = datetime.now(UTC).date() - calibration.date
        names = ("verdict", "rests_on", "spread")
        measured = {name: getattr(calibration, name) for name in names}
        measured |= {"calibrated": calibration.date, "age_days": age.days}
    of_screen = {"warnings": screen.warnings(), **measured}
    if screen.verified is not None:
        of_screen["verified"] = screen.verified.text
    of_finger: dict[str, Any] = {
        "warnings": [
            f"{name}: a placeholder, not measured"
            for name in ("roughness", "dielectric")
            if getattr(getattr(finger, name), "is_placeholder", False)
        ]
    }
    if sources["finger"] != finger.name:  # of the same calibration, if there was one
        of_finger["calibrated"] = measured.get("calibrated")
    profiles = {}
    for kind, used, facts in (("screen", screen, of_screen), ("finger", finger, of_finger)):
        source = "preset" if sources[kind] == used.name else sources[kind]
        document = used.model_dump(mode="json")
        profile = Profile(name=used.name, source=source, document=document, **facts)
        profiles[kind] = profile.model_dump(mode="json")
    return profiles
