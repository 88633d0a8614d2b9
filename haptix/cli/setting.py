"""What the options of ``demo``, ``render`` and ``play`` describe."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from haptix.arguments import read_pair
from haptix.errors import InputError, MissingExtraError, from_extra

if TYPE_CHECKING:
    from haptix.simulation import Setting
    from haptix.surface import FrictionSurface
    from haptix.texture import Feelable

_BRICKS = "scikit-image brick (CC0)"
_WITHOUT_PHOTOGRAPHS = "gallery:basket"


def setting_of(
    image: Path | None,
    width_mm: float | None,
    mu_range: str | None,
    trajectory: Path | None,
    finger: str,
    screen: str,
    carrier_hz: float | None = None,
    direct_hz: float | None = None,
    waveform: str = "sine",
    polarity: str = "bright-high",
    material: Path | None = None,
) -> tuple[Setting, str]:
    """Return what the options describe, and a name for the photograph or the material."""
    from haptix.finger import Finger
    from haptix.friction import ContactModel
    from haptix.gallery import load
    from haptix.motion import Trajectory
    from haptix.render import DirectWave, Drive, SineCarrier
    from haptix.screen import Screen
    from haptix.simulation import FINGER_PATH, Setting

    if carrier_hz is not None and direct_hz is not None:
        raise InputError("expected --carrier-hz or --direct-hz, got both")
    drive: Drive | None = None if carrier_hz is None else SineCarrier(carrier_hz)
    if direct_hz is not None:
        drive = DirectWave(direct_hz, waveform)
    path = Trajectory.from_csv(trajectory or FINGER_PATH)
    targets = None if mu_range is None else read_pair("--mu-range", mu_range)
    if material is None:
        texture, name = _texture(image, width_mm, targets, polarity)
    else:
        if image is not None or width_mm is not None or targets is not None:
            raise InputError("--material: expected no --image, --width-mm or --mu-range beside it")
        texture, name = load(material), str(material)
    model = ContactModel(Finger.named(finger), Screen.named(screen))
    return Setting(model, texture, path, drive), name


def current_of(current: Mapping[str, float]) -> str:
    """Say the expected current through the person beside its limits."""
    peak, rms = (
        f"{current[f'{kind}_a'] * 1e3:.2g} mA (limit {current[f'limit_{kind}_a'] * 1e3:g})"
        for kind in ("peak", "rms")
    )
    return f"at most {peak}, {rms} rms, through {current['capacitance_f'] * 1e12:.4g} pF"


def surface_of(setting: Setting, file: Path | None, on_progress: Any) -> FrictionSurface:
    """Return the surface of a file, or one that is built for the setting."""
    from haptix.surface import FrictionSurface

    if file is not None:
        return FrictionSurface.load(file, setting.model)
    return setting.surface(on_progress)[0]


def _texture(
    image: Path | None,
    width_mm: float | None,
    mu_range: tuple[float, float] | None,
    polarity: Any,
) -> tuple[Feelable, str]:
    """Texture, and what it is called."""
    from haptix.gallery import load
    from haptix.texture import Sidecar, Texture

    if image is None:
        try:
            with from_extra("figures"):
                from skimage.data import brick
        except MissingExtraError as error:
            if mu_range is not None:
                raise
            return load(_WITHOUT_PHOTOGRAPHS), f"{_WITHOUT_PHOTOGRAPHS}, no photograph: {error}"
        width_mm = 60.0 if width_mm is None else width_mm
        return Texture.from_image(brick(), width_mm, polarity, mu_range), _BRICKS
    if width_mm is not None:
        return Texture.from_image(image, width_mm, polarity, mu_range), str(image)
    if not Sidecar.path_for(image).exists():
        raise InputError(
            f"--image: {image} has no {Sidecar.path_for(image).name} beside it; give --width-mm"
        )
    return Texture.load(image), str(image)
