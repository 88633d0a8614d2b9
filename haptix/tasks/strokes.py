"""Tasks of strokes: demo, simulation, a played path, the reach of a screen."""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from haptix.base.errors import InputError, MissingExtraError, OverloadWarning, from_extra
from haptix.base.fields import (
    Address,
    FileThere,
    Folder,
    Force,
    ForClients,
    JsonObject,
    Local,
    MaterialFile,
    Positive,
    Range,
    Typed,
)
from haptix.base.report import row
from haptix.base.task import Context, Result, Task
from haptix.base.terminal import accuracy_note, placeholder_note, warning_note
from haptix.model.presets import (
    DEFAULT_CARRIER_HZ,
    FORCES_N,
    FingerName,
    ScreenName,
    breakdown_note,
)

if TYPE_CHECKING:
    from haptix.feel.materials import Feelable
    from haptix.model.friction import ContactModel
    from haptix.model.surface import FrictionSurface
    from haptix.play.simulation import Setting
    from haptix.play.touch import TouchEvent
    from haptix.play.virtual_finger import Evaluation


_ENDS_S = 0.05  # playing goes on after the last touch, until its effect has been played
_BRICKS = "scikit-image brick (CC0)"
_WITHOUT_PHOTOGRAPHS = "gallery:basket"
_KEPT_FIELDS = (
    *("finger", "screen", "pair", "placeholders", "beyond_verified", "target_mu"),
    *("evaluation", "parts", "periods", "out_of_range"),
)

MillimetresWide = Annotated[float, Field(ge=0.1, le=1e4)]
Touches = Field(min_length=2, max_length=20_000, fail_fast=True)
Finite = Annotated[float, Field(ge=-1e6, le=1e6)]


_A_FEW = 10  # so few samples may have been typed by a person: any spacing is allowed
_CORNER_MM = 0.5  # a stroke within so small a corner of the screen was written in metres

CarrierHz = Annotated[float, Field(ge=1000)]
"""Lowest carrier: skin follows a slower one, which is then a direct drive."""


class OnScreen(Task):
    """A finger on a screen; by default those in use."""

    finger: FingerName | None = Field(
        None, description="Finger. [default: finger.toml beside a calibrated screen, or semi-wet]"
    )
    screen: ScreenName | None = Field(
        None, description="Screen. [default: the device's installed profile, or 3m-sct3250]"
    )

    def model(self) -> ContactModel:
        """Return the contact model."""
        from haptix.model.friction import ContactModel
        from haptix.model.pair import profiles

        return ContactModel(*profiles(self.finger, self.screen))


class OfPhotograph(OnScreen):
    """A path over a photograph."""

    image: FileThere | None = Field(
        None, description="Photograph, with its JSON beside it or --width-mm. [default: bricks]"
    )
    width_mm: Annotated[MillimetresWide, Local()] | None = Field(
        None, description="Width of the photograph on the screen."
    )
    mu_range: Annotated[Range, Local()] | None = Field(
        None, description="LOW,HIGH friction coefficients. [default: the reach]"
    )
    trajectory: FileThere | None = Field(
        None,
        description="CSV: t_s, x_mm, y_mm, normal_force_n; or a recording of a touch panel by "
        "libinput record, evemu, getevent or hid-recorder. [default: a recorded path]",
    )
    carrier_hz: CarrierHz | None = Field(
        None, description="Frequency of the carrier. [default: 4000]"
    )

    def setting(self, model: ContactModel, polarity: str = "bright-high") -> tuple[Setting, str]:
        """Return the setting of the parameters, and a name of the felt material."""
        from haptix.feel.motion import Trajectory
        from haptix.play.render import SineCarrier
        from haptix.play.simulation import FINGER_PATH, Setting
        from haptix.play.touch import paths_of

        drive = None if self.carrier_hz is None else SineCarrier(self.carrier_hz)
        if (events := self.recorded(model)) is not None:
            path = paths_of(events)[0]
        else:
            path = Trajectory.from_csv(self.trajectory or FINGER_PATH)
        apart_s = path.duration_s / (len(path.t_s) - 1)
        if len(path.t_s) > _A_FEW and apart_s > 1.0:
            raise InputError(
                f"{self.trajectory}: t_s: expected seconds, got samples {apart_s:g} s apart; if "
                "these are milliseconds, divide them by 1000"
            )
        places_mm = path.x_mm, path.y_mm
        farthest_mm = max(float(abs(place).max()) for place in places_mm)
        if farthest_mm < _CORNER_MM and any((place != place[0]).any() for place in places_mm):
            raise InputError(
                f"{self.trajectory}: x_mm, y_mm: expected millimetres, got places within "
                f"{farthest_mm:g} mm; if these are metres, multiply them by 1000"
            )
        texture, name = self.texture(polarity)
        return Setting(model, texture, path, drive), name

    def recorded(self, model: ContactModel) -> list[TouchEvent] | None:
        """Return the touches of a panel's recording; None where the path is a CSV."""
        from haptix.play.touch import is_recording, read_recording

        if self.trajectory is None or not is_recording(self.trajectory):
            return None
        screen = model.screen
        try:
            return read_recording(self.trajectory)
        except InputError as error:
            if screen.width_mm is None or screen.height_mm is None:
                why = f"{error} and height_mm in the screen's profile"
                raise InputError(why) from None
        return read_recording(self.trajectory, screen.width_mm, screen.height_mm)

    def texture(self, polarity: Any) -> tuple[Feelable, str]:
        """Return the photograph and its name."""
        from haptix.feel.gallery import load
        from haptix.feel.materials import Sidecar, Texture

        image, width_mm = self.image, self.width_mm
        ends: tuple[Any, ...] = () if self.mu_range is None else ("mu", *self.mu_range)
        if image is None:
            try:
                with from_extra("figures"):
                    from skimage.data import brick
            except MissingExtraError as error:
                if self.mu_range is not None:
                    raise
                return load(_WITHOUT_PHOTOGRAPHS), f"{_WITHOUT_PHOTOGRAPHS}, no photograph: {error}"
            return Texture.from_image(brick(), width_mm or 60.0, polarity, *ends), _BRICKS
        if width_mm is not None:
            return Texture.from_image(image, width_mm, polarity, *ends), str(image)
        if not Sidecar.path_for(image).exists():
            name = Sidecar.path_for(image).name
            raise InputError(f"--image: {image} has no {name} beside it; give --width-mm")
        return Texture.load(image), str(image)


class Demo(OfPhotograph, command="demo"):
    """From a photograph to what a finger feels: everything once, without hardware.

    Writes demo.png, drive.wav with drive.json, felt.csv and summary.json.
    """

    screen: ScreenName = Field(
        "3m-sct3250", description="Screen: a preset (3m-sct3250) or a TOML file."
    )
    width_mm: MillimetresWide = Field(60.0, description="Width of the photograph on the screen.")
    carrier_hz: CarrierHz = Field(DEFAULT_CARRIER_HZ, description="Frequency of the carrier.")
    polarity: Literal["bright-high", "dark-high"] = Field(
        "bright-high", description="bright-high or dark-high: which grey has high friction."
    )
    out: Folder = Field(Path("haptix-demo"), description="Folder for the outputs.")
    figure: bool = Field(
        False, description="Draw a laboratory's five panels: also force, voltage and wave."
    )

    def run(self, context: Context) -> Result:
        """Build, simulate, write."""
        # torch and matplotlib load here: the bar should already cover these seconds.
        context.progress("solve the contact, build the surface", 0.0)
        from haptix.base.files import check_folder
        from haptix.feel.materials import Texture
        from haptix.model.pair import first_line
        from haptix.play.simulation import FILES, simulate, write

        check_folder(self.out, ("demo.png", *FILES))
        setting, photograph = self.setting(self.model(), self.polarity)
        began_s = time.perf_counter()
        update = partial(context.progress, "solve the contact, build the surface")
        surface, was_cached = setting.surface(update)
        built_s = time.perf_counter()
        update = partial(context.progress, "slide the finger, render, play")
        simulation = simulate(setting, surface, on_progress=update)
        about = {
            "photograph": photograph,
            "width_mm": self.width_mm if isinstance(setting.texture, Texture) else None,
            "polarity": self.polarity,
            "is_surface_cached": was_cached,
            "seconds": {
                "surface": round(built_s - began_s, 3),
                "simulation": round(time.perf_counter() - built_s, 3),
            },
        }
        context.progress("write the files", 0.0)
        summary = write(self.out, simulation, about, "demo.png", 5 if self.figure else 2)
        past = breakdown_note(summary["pull_past_breakdown"])
        title = f"{first_line(summary)}\nhaptix demo: outputs in {self.out}{past}"
        return Result([summary], [(title, _summary_rows(summary, simulation.evaluation))])


class OfPath(OfPhotograph):
    """A path over a photograph or a material, by the live renderer."""

    material_file: Annotated[MaterialFile, Typed("--material")] | None = Field(
        None,
        description="Material: TOML or JSON, or gallery:NAME, see `haptix material`; instead of a "
        "photograph.",
    )
    surface: FileThere | None = Field(
        None, description="Surface of `haptix build`. [default: built for the path]"
    )
    direct_hz: Positive | None = Field(
        None, description="Drive at this frequency, without a carrier."
    )
    waveform: Literal["sine", "square"] = Field(
        "sine", description="Waveform of the direct drive: sine or square."
    )
    reaction_ms: Annotated[float, Field(gt=0, le=1000)] = Field(
        3.0, description="From a touch to its effect on the output."
    )
    horizon_ms: Annotated[float, Field(gt=0, le=1e4)] = Field(
        100.0, description="Longest stall that causes no underrun."
    )

    def setting(self, model: ContactModel, polarity: str = "bright-high") -> tuple[Setting, str]:
        """Return the setting of the parameters, and a name of the felt material."""
        from haptix.play.render import DirectWave

        if self.carrier_hz is not None and self.direct_hz is not None:
            raise InputError("expected --carrier-hz or --direct-hz, got both")
        setting, name = super().setting(model, polarity)
        if self.direct_hz is not None:
            setting = replace(setting, drive=DirectWave(self.direct_hz, self.waveform))
        return setting, name

    def texture(self, polarity: Any) -> tuple[Feelable, str]:
        """Return the material or the photograph, and its name."""
        from haptix.feel.gallery import load

        if self.material_file is None:
            return super().texture(polarity)
        if (self.image, self.width_mm, self.mu_range) != (None, None, None):
            raise InputError("--material: expected no --image, --width-mm or --mu-range beside it")
        return load(self.material_file), str(self.material_file)

    def built(self, setting: Setting, context: Context, ceiling_v: float) -> FrictionSurface:
        """Return the surface of a file, or one that is built for the setting and a device."""
        from haptix.model.surface import FrictionSurface

        if self.surface is not None:
            return FrictionSurface.load(self.surface, setting.model)
        update = partial(context.progress, "build the surface")
        return setting.surface(update)[0].limited(ceiling_v)


class Render(OfPath, command="render", route="renderings", kind="rendering"):
    """Simulate live touches: a virtual finger feels the drive, and the error is split.

    Writes simulation.png, felt.csv, drive.wav with drive.json, and summary.json.
    """

    stages: ClassVar[tuple[str, ...]] = ("build the surface", "play and feel")

    touch_hz: Annotated[float, Field(ge=1, le=10_000)] = Field(
        100.0, description="Reports of the touch panel per second."
    )
    touch_latency_ms: Annotated[float, Field(ge=0, le=1000)] = Field(
        20.0, description="Delay of its reports."
    )
    out: Folder = Field(Path("haptix-render"), description="Folder for the outputs.")
    device: Address = Field("mock:", description="A mock device, with its options.")
    material: Annotated[JsonObject, ForClients()] | None = None
    t_s: Annotated[tuple[Finite, ...], ForClients(), Touches] | None = Field(
        None, examples=[[0, 1]]
    )
    x_mm: Annotated[tuple[Finite, ...], ForClients(), Touches] | None = Field(
        None, examples=[[5, 55]]
    )
    y_mm: Annotated[tuple[Finite, ...], ForClients(), Touches] | None = Field(
        None, examples=[[20, 20]]
    )
    normal_force_n: Annotated[tuple[Force, ...], ForClients(), Touches] | None = Field(
        None, examples=[[0.5, 0.5]]
    )

    def run(self, context: Context) -> Result:
        """Build, play and feel; write the files if there is a folder."""
        context.progress("build the surface", 0.0)
        from haptix.base.files import check_folder
        from haptix.model.pair import first_line
        from haptix.play.devices import open_device, profiles_for
        from haptix.play.render import LiveSettings
        from haptix.play.simulation import FILES, errors_of, simulate, write
        from haptix.play.simulation.folder import summary_of
        from haptix.play.virtual_finger import TouchPanel

        finger, screen = self.finger, self.screen
        if context.folder is not None:
            check_folder(context.folder / self.out, ("simulation.png", *FILES))
            if not self.device.startswith("mock:"):  # before the surface is built
                raise InputError(
                    f"--device: expected a mock device, whose output can be felt, got {self.device}"
                    "; `haptix play` plays on a driver"
                )
        with closing(open_device(self.device)) as opened:  # with a driver's serial number
            ceiling_v = opened.limits.ceiling_v
            if context.folder is not None:
                finger, screen = profiles_for(opened, finger, screen)
        named = self.model_copy(update={"finger": finger, "screen": screen})
        setting, photograph = named.setting(named.model())
        surface = self.built(setting, context, ceiling_v)
        simulation = simulate(
            setting,
            surface,
            TouchPanel(self.touch_hz, self.touch_latency_ms / 1e3),
            LiveSettings(reaction_s=self.reaction_ms / 1e3, horizon_s=self.horizon_ms / 1e3),
            self.device,
            partial(context.progress, "play and feel"),
        )
        if context.folder is None:  # a client of the network gets no volts
            summary = summary_of(simulation)
            return Result({name: summary[name] for name in _KEPT_FIELDS})
        same = ("touch_hz", "touch_latency_ms", "reaction_ms", "horizon_ms")
        about = {"photograph": photograph, **{name: getattr(self, name) for name in same}}
        summary = write(context.folder / self.out, simulation, about)
        title = f"{first_line(summary)}\nhaptix render: outputs in {self.out}"
        title += f"; current {_current(summary['current'])}"
        title += accuracy_note(summary["accuracy"])
        title += breakdown_note(summary["pull_past_breakdown"])
        title += placeholder_note(summary["placeholders"])
        title += warning_note(summary["beyond_verified"])
        return Result([summary], [(title, errors_of(simulation))])

    def setting(self, model: ContactModel, polarity: str = "bright-high") -> tuple[Setting, str]:
        """Return the setting of the parameters, with a client's stroke in place of files."""
        from haptix.feel.materials import material_of
        from haptix.feel.motion import Trajectory
        from haptix.play.simulation import Setting

        if self.material is None:
            return super().setting(model, polarity)
        columns = [self.t_s or (), self.x_mm or (), self.y_mm or (), self.normal_force_n or ()]
        return Setting(model, material_of(self.material), Trajectory.of(*columns)), "material"


class PlayPath(OfPath, command="play"):
    """Play a recorded path on a device, in real time."""

    device: Address = Field("mock:pace=real", description="Where to play, see `haptix devices`.")

    def run(self, context: Context) -> Result:
        """Play it."""
        context.progress("build the surface", 0.0)
        from haptix.model.pair import described, first_line
        from haptix.play.devices import open_device, profiles_for
        from haptix.play.render import LiveRenderer, LiveSettings
        from haptix.play.touch import events_of, paced

        with closing(open_device(self.device)) as opened:
            finger, screen = profiles_for(opened, self.finger, self.screen)
            model = self.model_copy(update={"finger": finger, "screen": screen}).model()
            setting, _ = self.setting(model)
            surface = self.built(setting, context, opened.limits.ceiling_v)
            events = self.recorded(model) or events_of(setting.path)
            # Not strict: after a stall of this machine, touches come too late to matter.
            live = LiveSettings(
                reaction_s=self.reaction_ms / 1e3, horizon_s=self.horizon_ms / 1e3, strict=False
            )
            renderer = LiveRenderer(surface, setting.texture, opened, setting.drive, live)
            with warnings.catch_warnings(), renderer:
                warnings.simplefilter("ignore", OverloadWarning)  # reported below
                for number, event in enumerate(paced(events, clock=renderer.now_s), 1):
                    renderer.event(event)
                    context.progress("play", number / len(events))
                renderer.run_until(renderer.now_s() + _ENDS_S)
        stats = renderer.stats
        seen: dict[str, float | str] = {
            "seconds": stats.samples_played / renderer.sample_rate_hz,
            "reaction_ms": stats.reaction_s * 1e3,
            "underruns": stats.underruns,
            "block_p50_ms": stats.p50_block_s * 1e3,
            "block_p99_ms": stats.p99_block_s * 1e3,
            "too_low": stats.below / max(stats.samples, 1),
            "too_high": stats.above / max(stats.samples, 1),
        }
        more: dict[str, float | str] = {"advice": stats.advice}
        about = described(model.finger, model.screen)
        beyond = renderer.verified.sentences
        more["beyond_verified"] = "; ".join(beyond)
        title = f"{first_line(about)}\nhaptix play: {self.device}"
        if stats.revisions:
            p50_ms, p99_ms = stats.reaction_p50_s * 1e3, stats.reaction_p99_s * 1e3
            title += f"; reaction {p50_ms:.2g} ms (99 %: {p99_ms:.2g})"
            more |= {"revisions": stats.revisions, "refused": stats.refused}
            more |= {"reaction_p50_ms": p50_ms, "reaction_p99_ms": p99_ms}
        title = f"{title}; {stats.advice}" if stats.advice else title
        title += warning_note(beyond)
        return Result([seen | more | about], [(title, [seen])])


class Headroom(OnScreen, route="headroom", kind="headroom"):
    """Count where a material asks for more or less friction than a screen can give."""

    stages: ClassVar[tuple[str, ...]] = ("build the surface",)

    material: Annotated[JsonObject, ForClients()]
    width_mm: Annotated[float, Field(gt=0, le=1e4)]
    height_mm: Annotated[float, Field(gt=0, le=1e4)]
    normal_force_n: Force = 0.5
    columns: Annotated[int, Field(ge=1, le=1000)] = 300
    highest_v: Annotated[Positive, Local()] | None = Field(
        None, description="Highest amplitude of the drive. [default: what the screen may carry]"
    )

    def run(self, context: Context) -> Result:
        """Shares of a material's places that are out of reach, and the range."""
        from haptix.feel.materials import as_mu, material_of
        from haptix.feel.materials.picture import picture
        from haptix.model.status import Status
        from haptix.model.surface import cached_surface

        scene = {"normal_force_n": self.normal_force_n, "frequency_hz": DEFAULT_CARRIER_HZ}
        update = partial(context.progress, "build the surface")
        surface, _ = cached_surface(self.model(), scene, "0.05 JND", update)
        material = material_of(self.material)
        column = surface.driven_at(DEFAULT_CARRIER_HZ).column(self.normal_force_n, None)
        column = column.limited(self.highest_v or surface.voltage_limit_v)
        low, high = float(column.lowest_mu), float(column.highest_mu)
        wanted = picture(material, self.width_mm, self.height_mm, self.columns, 0.0)
        target = as_mu(material.evaluator.target, wanted, low, high)
        _, status = column.voltage(target)
        return Result(
            {
                "below": float((status == Status.BELOW).mean()),
                "above": float((status == column.ends_by).mean()),
                "lowest_mu": low,
                "highest_mu": high,
                "target_mu": [float(target.min()), float(target.max())],
            }
        )


class KeepSurface(OnScreen, route="surfaces", kind="surface"):
    """Build a surface and keep it; a surface that is kept already is used."""

    stages: ClassVar[tuple[str, ...]] = ("build the surface",)

    tolerance_jnd: Annotated[float, Field(ge=0.01, le=1)] = 0.05

    def run(self, context: Context) -> Result:
        """Build a surface as the service does at its start."""
        from haptix.model.surface import cached_surface

        scene = {"normal_force_n": FORCES_N, "frequency_hz": DEFAULT_CARRIER_HZ}
        tolerance = f"{self.tolerance_jnd:g} JND"
        update = partial(context.progress, "build the surface")
        surface, was_kept = cached_surface(self.model(), scene, tolerance, update)
        info = surface.info
        return Result(
            {
                "key": info["key"],
                "was_kept": was_kept,
                "grid": list(surface.mu_table.shape),
                "error_max_mu": info.get("error_max"),
                "error_p99_mu": info.get("error_p99"),
            }
        )


def _current(current: Mapping[str, float]) -> str:
    """Return the expected current through the person and its limits, in words."""
    peak, rms = (
        f"{current[f'{kind}_a'] * 1e3:.2g} mA (limit {current[f'limit_{kind}_a'] * 1e3:g})"
        for kind in ("peak", "rms")
    )
    return f"at most {peak}, {rms} rms, through {current['capacitance_f'] * 1e12:.4g} pF"


def _summary_rows(summary: Mapping[str, Any], errors: Evaluation) -> list[dict[str, str]]:
    shares, stream, surface = summary["out_of_range"], summary["stream"], summary["surface"]
    origin = "from the cache" if summary["is_surface_cached"] else "built"
    low, high = summary["target_mu"]
    width = "" if summary["width_mm"] is None else f", {summary['width_mm']:g} mm wide"
    lines = {
        "photograph": f"{summary['photograph']}{width}",
        "placeholders": " and ".join(summary["placeholders"]),
        "surface": f"{origin} in {summary['seconds']['surface']:.2f} s, error in mu at most "
        f"{surface['error_max_mu']:.1g}",
        "target friction": f"{low:.3f} to {high:.3f}",
        "error": ", ".join(f"{heading} {cell}" for heading, cell in row(errors).items()),
        "samples": errors.counts,
        "out of reach": f"{shares['share_below']:.1%} too low, {shares['share_above']:.1%} too "
        f"high, {shares['share_outside_surface']:.1%} outside the surface",
        "past breakdown": f"{summary['pull_past_breakdown']:.0%} of the attraction at its "
        "strongest, from gaps whose field is past what they bear",
        "current": _current(summary["current"]),
        "block times": f"median {stream['block_p50_ms']:.2f} ms, 99 % below "
        f"{stream['block_p99_ms']:.2f} ms, for {stream['block_length_ms']:.2f} ms of signal",
        "stream": f"{stream['frames_sent']} frames, {stream['bytes_sent']} bytes, "
        f"{stream['underruns']} underruns, {stream['faults']} faults",
        "picture": summary["picture"],
    }
    return [{"": name, "result": text} for name, text in lines.items()]
