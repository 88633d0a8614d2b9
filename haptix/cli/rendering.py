"""``haptix render`` and ``play``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from haptix.terminal import AsJson, placeholder_note, progress_bar, show

if TYPE_CHECKING:
    from haptix.friction import ContactModel
    from haptix.motion import Trajectory
    from haptix.render import Drive
    from haptix.surface import FrictionSurface
    from haptix.texture import FrictionField

Image = Annotated[
    Path | None,
    typer.Option(help="Photograph, with its JSON beside it or --width-mm. [default: bricks]"),
]
FingerPath = Annotated[
    Path | None,
    typer.Option(help="CSV: t_s, x_mm, y_mm, normal_force_n. [default: one that ships]"),
]
Width = Annotated[float | None, typer.Option(help="Width of the photograph on the screen.")]
Range = Annotated[
    str | None, typer.Option(help="LOW,HIGH friction coefficients. [default: what is reachable]")
]
Surface = Annotated[
    Path | None, typer.Option(help="Surface of `haptix build`. [default: built for the path]")
]
FingerName = Annotated[str, typer.Option(help="Finger: a preset's name or a TOML file.")]
ScreenName = Annotated[str, typer.Option(help="Screen: a preset's name or a TOML file.")]
CarrierHz = Annotated[float | None, typer.Option(help="Frequency of the carrier. [default: 4000]")]
DirectHz = Annotated[float | None, typer.Option(help="Drive at this frequency, without a carrier.")]
Waveform = Annotated[str, typer.Option(help="Of the direct drive: sine or square.")]
LeadMs = Annotated[float, typer.Option(help="From computing a sample to its being played.")]

_TOLERANCE = 5e-4  # of a surface that is built for the path, in mu


def render(
    out: Annotated[Path, typer.Option(help="Folder for the outputs.")] = Path("haptix-render"),
    image: Image = None,
    width_mm: Width = None,
    mu_range: Range = None,
    trajectory: FingerPath = None,
    surface: Surface = None,
    finger: FingerName = "semi-wet",
    screen: ScreenName = "3m-sct3250",
    carrier_hz: CarrierHz = None,
    direct_hz: DirectHz = None,
    waveform: Waveform = "sine",
    touch_hz: Annotated[float, typer.Option(help="Reports of the touch panel per second.")] = 100.0,
    touch_latency_ms: Annotated[float, typer.Option(help="By which its reports come late.")] = 20.0,
    lead_ms: LeadMs = 25.0,
    device: Annotated[str, typer.Option(help="A mock device, with its options.")] = "mock:",
    as_json: AsJson = False,
) -> None:
    """Rehearse: a virtual finger feels what would be played, and says what the error is made of.

    Writes rehearsal.png, felt.csv, drive.wav and summary.json.
    """
    with progress_bar({"surface": "build the surface", "render": "play and feel"}) as update:
        update("surface", 0.0)
        from haptix.rehearsal import rehearse
        from haptix.rehearsal.folder import summary_of, write
        from haptix.render import LiveSettings
        from haptix.virtual_finger import TouchPanel

        job = _Job(image, width_mm, mu_range, trajectory, finger, screen)
        found = job.surface(surface, carrier_hz, direct_hz, lambda share: update("surface", share))
        panel = TouchPanel(touch_hz, touch_latency_ms / 1e3)
        rehearsal = rehearse(
            job.model,
            found,
            job.texture,
            job.path,
            panel,
            address=device,
            on_progress=lambda share: update("render", share),
            drive=_drive(carrier_hz, direct_hz, waveform),
            settings=LiveSettings(lead_s=lead_ms / 1e3),
        )
        about = {
            "photograph": job.photograph,
            "finger": finger,
            "screen": screen,
            "placeholder_note": job.model.placeholders(),
            "surface_key": found.info["key"],
            "touch_hz": touch_hz,
            "touch_latency_ms": touch_latency_ms,
            "lead_ms": lead_ms,
        }
        write(out, rehearsal, job.texture, about)
    summary = summary_of(rehearsal)
    title = f"haptix render: outputs in {out}; {finger} finger on {screen}"
    title += placeholder_note(job.model.placeholders())
    show(title, [summary] if as_json else _rows(summary), as_json)


def play(
    image: Image = None,
    width_mm: Width = None,
    mu_range: Range = None,
    trajectory: FingerPath = None,
    surface: Surface = None,
    finger: FingerName = "semi-wet",
    screen: ScreenName = "3m-sct3250",
    carrier_hz: CarrierHz = None,
    direct_hz: DirectHz = None,
    waveform: Waveform = "sine",
    lead_ms: LeadMs = 25.0,
    device: Annotated[str, typer.Option(help="Where to play, see `haptix devices`.")] = (
        "mock:pace=real"
    ),
    as_json: AsJson = False,
) -> None:
    """Play a recorded path on a device, in real time."""
    with progress_bar({"surface": "build the surface", "play": "play"}) as update:
        update("surface", 0.0)
        import time

        from firmware_io import open_device
        from haptix.render import LiveRenderer, LiveSettings

        job = _Job(image, width_mm, mu_range, trajectory, finger, screen)
        found = job.surface(surface, carrier_hz, direct_hz, lambda share: update("surface", share))
        opened = open_device(device)
        try:
            drive = _drive(carrier_hz, direct_hz, waveform)
            settings = LiveSettings(lead_s=lead_ms / 1e3)
            renderer = LiveRenderer(found, job.texture, opened, drive, settings)
            path = job.path
            with renderer:
                start = renderer.now_s() - float(path.t_s[0])
                for t, x, y, force in zip(
                    path.t_s, path.x_mm, path.y_mm, path.normal_force_n, strict=True
                ):
                    time.sleep(max(0.0, start + t - renderer.now_s()))
                    renderer.touch(start + t, x, y, force)
                    update("play", (t - path.t_s[0]) / path.duration_s)
                renderer.lift(renderer.now_s())
                time.sleep(2 * lead_ms / 1e3)
        finally:
            opened.close()
    stats = renderer.stats
    row = {
        "seconds": stats.samples / opened.capabilities.sample_rate_hz,
        "lead_ms": stats.lead_s * 1e3,
        "underruns": stats.underruns,
        "late_blocks": stats.late_blocks,
        "block_p50_ms": stats.p50_block_s * 1e3,
        "block_p99_ms": stats.p99_block_s * 1e3,
        "too_low": stats.below / max(stats.samples, 1),
        "too_high": stats.above / max(stats.samples, 1),
    }
    show(f"haptix play: {device}", [row], as_json)


class _Job:
    """What both commands are told in the same words."""

    def __init__(
        self,
        image: Path | None,
        width_mm: float | None,
        mu_range: str | None,
        trajectory: Path | None,
        finger: str,
        screen: str,
    ) -> None:
        from haptix.cli.numbers import read_pair
        from haptix.demo.job import FINGER_PATH
        from haptix.finger import Finger
        from haptix.friction import ContactModel
        from haptix.motion import Trajectory
        from haptix.screen import Screen

        self.path: Trajectory = Trajectory.from_csv(trajectory or FINGER_PATH)
        wanted = None if mu_range is None else read_pair("mu-range", mu_range)
        self.photograph = str(image or "scikit-image brick (CC0)")
        self.texture: FrictionField = _texture(image, width_mm, wanted)
        self.model: ContactModel = ContactModel(Finger.named(finger), Screen.named(screen))

    def surface(
        self, file: Path | None, carrier_hz: float | None, direct_hz: float | None, on_progress: Any
    ) -> FrictionSurface:
        from haptix.errors import InputError
        from haptix.surface import FrictionSurface, cached_surface

        if carrier_hz is not None and direct_hz is not None:
            raise InputError("expected --carrier-hz or --direct-hz, got both")
        if file is not None:
            return FrictionSurface.load(file, self.model)
        force = self.path.normal_force_n
        scene = {
            "normal_force_n": (float(force.min()), float(force.max())),
            "frequency_hz": direct_hz or carrier_hz or 4000.0,
        }
        return cached_surface(self.model, scene, _TOLERANCE, on_progress)[0]


def _texture(
    image: Path | None, width_mm: float | None, mu_range: tuple[float, float] | None
) -> FrictionField:
    from haptix.errors import InputError
    from haptix.texture import Sidecar, Texture

    if image is None:
        from skimage.data import brick

        return Texture.from_image(
            brick(), 60.0 if width_mm is None else width_mm, mu_range=mu_range
        )
    if width_mm is not None:
        return Texture.from_image(image, width_mm, mu_range=mu_range)
    if not Sidecar.path_for(image).exists():
        raise InputError(
            f"--image: {image} has no {Sidecar.path_for(image).name} beside it; give --width-mm"
        )
    return Texture.load(image)


def _drive(carrier_hz: float | None, direct_hz: float | None, waveform: str) -> Drive | None:
    from haptix.render import DirectWave, SineCarrier

    if direct_hz is not None:
        return DirectWave(direct_hz, waveform)
    return None if carrier_hz is None else SineCarrier(carrier_hz)


def _rows(summary: Mapping[str, Any]) -> list[dict[str, Any]]:
    rows = [(name, part) for name, part in summary["parts"].items()]
    return [
        {
            "error": name,
            "rms_mu": part["error_rms_mu"],
            "p95_mu": part["error_p95_mu"],
            "p95_thresholds": part["error_p95_thresholds"],
            "what": part.get("what") or _judged(part),
        }
        for name, part in [*rows, ("all", summary["verdict"])]
    ]


def _judged(verdict: Mapping[str, Any]) -> str:
    share = verdict["judged"] / verdict["samples"]
    return (
        f"judged over {share:.0%} of the path; still {verdict['still'] / verdict['samples']:.0%}, "
        f"out of reach {verdict['unreachable'] / verdict['samples']:.0%}"
    )
