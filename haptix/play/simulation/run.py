"""Play a texture to the virtual finger, without hardware; compare a texture with its recording."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from firmware_io import Device, open_device
from haptix.base.checks import Array
from haptix.base.display import Displayed, axes_or_new
from haptix.base.errors import InputError
from haptix.base.fields import LIFTED_BELOW_N
from haptix.feel.materials import Feelable, RecordedProfile, as_mu
from haptix.feel.materials.spectral import (
    BANDS_HZ,
    Energies,
    Spectral,
    Stretch,
    band_energies,
    decibels,
)
from haptix.feel.motion import Motion, Trajectory
from haptix.feel.motion.block import facts_on
from haptix.model.friction import ContactModel
from haptix.model.presets import DEFAULT_CARRIER_HZ
from haptix.model.states import ContactState
from haptix.model.status import Status
from haptix.model.surface import FrictionSurface, cached_surface
from haptix.play.render import DirectWave, Drive, LiveRenderer, LiveSettings, Renderer
from haptix.play.touch import TouchEvent, events_of
from haptix.play.virtual_finger import (
    FELT_WITHIN_S,
    Evaluation,
    Felt,
    TouchPanel,
    VirtualFinger,
    evaluate,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


FINGER_PATH = Path(__file__).parent / "finger_path.csv"
"""A recorded path of a finger, for the examples and `haptix demo`."""

_FEWEST_PERIODS = 10
_TOLERANCE = 5e-4  # of the surface, in mu; a sixtieth of a JND at mu = 0.27

_ENDS_S = 0.01  # a driver ramps to 0 V in less
_FEWEST_SAMPLES = 4  # that the virtual finger feels
PARTS: Mapping[str, str] = {
    "finger": "what no drive can change: the finger's own response smooths friction along its path",
    "surface": "interpolation of the friction surface, against the contact model itself",
    "modulation": "the wave on the device's clock: against an ideal carrier of its amplitude; of a "
    "direct drive, friction over a period and the finger's response, against the target",
    "quantisation": "the device's 16 bits, against real numbers",
    "prediction": "touches at the panel's rate, noise and latency, against the true path",
}
"""Sources of error. All that a direct drive does to the finger is in its modulation."""

# Of the secant: 1/mu is nearly linear in V^2, and the surface's amplitude is near to begin with.
_ITERATIONS = 5
_LOOKED_AT = 200  # periods of a path


@dataclass(frozen=True)
class Setting(Displayed):
    """A finger on a screen, and a texture for it to feel along a path.

    Parameters
    ----------
    model : ContactModel
        True finger and screen.
    texture : FrictionField or Material
        Target friction.
    path : Trajectory
        True path of the finger.
    drive : Drive, optional
        Carrier of the amplitude; the default is the surface's carrier.

    Raises
    ------
    InputError
        If the path is shorter than ten periods of the drive.
    """

    model: ContactModel
    texture: Feelable
    path: Trajectory
    drive: Drive | None = None

    def __post_init__(self) -> None:
        frequency_hz = self.frequency_hz
        if self.path.duration_s * frequency_hz < _FEWEST_PERIODS:
            raise InputError(
                f"trajectory: expected {_FEWEST_PERIODS} periods or more of the "
                f"{frequency_hz:g} Hz drive, got {self.path.duration_s:g} s; give a "
                "longer path or a higher frequency"
            )

    def surface(
        self, on_progress: Callable[[float], None] | None = None
    ) -> tuple[FrictionSurface, bool]:
        """Load or build a surface for the path's forces; say whether it came from the cache."""
        force = self.path.normal_force_n
        touching = force[force >= LIFTED_BELOW_N]
        if not len(touching):
            raise InputError("trajectory: expected a finger that touches, got no force above 0 N")
        ends = (float(touching.min()), float(touching.max()))
        scene = {"normal_force_n": ends, "frequency_hz": self.frequency_hz}
        return cached_surface(self.model, scene, _TOLERANCE, on_progress)

    @property
    def frequency_hz(self) -> float:
        """Of the drive."""
        return DEFAULT_CARRIER_HZ if self.drive is None else self.drive.frequency_hz


@dataclass(frozen=True)
class Played(Displayed):
    """Samples that a renderer sent along a path, and those that the device played.

    Parameters
    ----------
    setting : Setting
        Finger, screen, texture, path and drive.
    renderer : Renderer or LiveRenderer
        The renderer, with its counts, times and blocks.
    device : Device
        The device, closed.
    drive_v : ndarray, shape (samples,)
        Voltage that it played.
    start_s : float
        Time of the first sample on the path's clock [s].
    """

    setting: Setting
    renderer: Renderer | LiveRenderer
    device: Device
    drive_v: Array
    start_s: float

    def feel(
        self, finger: VirtualFinger, drive_v: Array | None = None, output_rate_hz: float = 10_000.0
    ) -> Felt:
        """Return the friction that a finger on the path felt of a drive, or of the device's output.

        Parameters
        ----------
        finger : VirtualFinger
        drive_v : array, shape (samples,), optional
            A drive [V]; the device's output if not given.
        output_rate_hz : float
            Of the friction that is felt [Hz].
        """
        drive_v = self.drive_v if drive_v is None else drive_v
        lacking = max(0, _FEWEST_SAMPLES - len(drive_v))
        drive_v = np.append(drive_v, np.zeros(lacking))
        path = self.setting.path
        along = (path.t_s, path.x_mm, path.y_mm, path.normal_force_n)
        rate_hz = self.renderer.sample_rate_hz
        return finger.feel(drive_v, rate_hz, *along, self.start_s, output_rate_hz)

    def collected(self, name: str) -> Array:
        """Return one array of all blocks, joined."""
        return np.concatenate([getattr(block, name) for block in self.renderer.blocks])

    def is_settled(self, t_s: Array) -> npt.NDArray[np.bool_]:
        """Whether no fade lowers the amplitude at times [s], and the end is not near.

        The device ends with a ramp to 0 V; the virtual finger, band-limited to 5 kHz, feels the
        step to it a little early.
        """
        renderer = self.renderer
        at_s = self.start_s + self.collected("sample") / renderer.sample_rate_hz
        gain = np.concatenate(
            [b.gain if b.fingers else np.zeros(len(b.amplitude_v)) for b in renderer.blocks]
        )
        has_faded_in = np.interp(t_s, at_s, gain, left=0.0) == 1.0
        return np.asarray(has_faded_in & (t_s < at_s[-1] - FELT_WITHIN_S))


def play_known(
    setting: Setting,
    surface: FrictionSurface,
    settings: LiveSettings,
    address: str,
    on_progress: Callable[[float], None],
) -> Played:
    """Play the true path: no panel, latency or prediction."""
    device = _mock(address, "virtual")
    settings = replace(settings, keep_blocks=True)
    path = setting.path
    with Renderer(surface, setting.texture, device, setting.drive, settings) as renderer:
        touches = events_of(path)[:-1]  # without the lift
        for number, touch in enumerate(touches, 1):
            renderer.event(touch)
            on_progress(number / len(touches))
    return _played(setting, renderer, float(path.t_s[0]))


def play_live(
    setting: Setting,
    surface: FrictionSurface,
    panel: TouchPanel,
    settings: LiveSettings,
    address: str,
) -> Played:
    """Play a touch panel's reports of the path, as a live renderer does, in steps."""
    seen = panel.read(setting.path)
    device = _mock(address, "stepped")
    start_s = float(setting.path.t_s[0])
    with LiveRenderer(surface, setting.texture, device, setting.drive, settings) as renderer:
        columns = (seen.t_s, seen.x_mm, seen.y_mm, seen.normal_force_n, seen.arrival_s)
        last_s, scan_s = start_s, 1 / panel.rate_hz
        for t, x, y, force, arrival in zip(*(c.tolist() for c in columns), strict=True):
            if t - last_s > 1.5 * scan_s:  # lifted: the panel reports it with its next scan
                lifted_s = last_s + scan_s - start_s
                up = TouchEvent(lifted_s, 0, x, y, "up")
                renderer.event(up, lifted_s + panel.latency_s)
            last_s = t
            renderer.event(TouchEvent(t - start_s, 0, x, y, "move", force), arrival - start_s)
        renderer.run_until(max(renderer.now_s(), setting.path.duration_s))
    device.clock.sleep(_ENDS_S)
    return _played(setting, renderer, start_s)


def _played(setting: Setting, renderer: Renderer | LiveRenderer, start_s: float) -> Played:
    """Close the device, and return its output."""
    device, driver = renderer.device, renderer.device.mock
    assert driver is not None
    device.close()
    return Played(setting, renderer, device, driver.played_v, start_s)


def _mock(address: str, pace: str) -> Device:
    """Open a mock device with the options of an address, at a pace."""
    scheme, _, options = address.partition(":")
    if scheme != "mock":
        raise InputError(f"device: expected a mock device, whose output can be felt, got {address}")
    kept = [option for option in options.split(",") if option and not option.startswith("pace=")]
    return open_device(f"mock:{','.join([*kept, f'pace={pace}'])}")


def felt_in_steps(known: Played, finger: VirtualFinger, h0_m: float) -> dict[str, Felt]:
    """Return the felt friction with each source of error in `PARTS` switched off in turn.

    `known` has played the true path and kept its blocks: "prediction" is not among the sources.
    """
    renderer, path = known.renderer, known.setting.path
    rate, drive = renderer.sample_rate_hz, renderer.drive
    step = renderer.blocks[0].step
    sent = known.collected("amplitude_v")
    exact = _without_surface(known, sent, h0_m)
    with_surface = known.feel(finger, known.collected("drive_v"))
    quantised = known.feel(finger)
    if isinstance(drive, DirectWave):
        points = np.arange(len(exact) + 1) * step
        line = np.interp(np.arange(points[-1]), points, np.append(0.0, exact))
        limit = known.setting.model.screen.max_voltage_v
        ideal = known.feel(finger, drive.modulate(line, 0, rate).clip(-limit, limit))
        return {"modulation": ideal, "surface": with_surface, "quantisation": quantised}

    def feel_ideal(amplitude_v: Array) -> Felt:
        along = (path.t_s, path.x_mm, path.y_mm, path.normal_force_n)
        start_s = known.start_s + step / rate
        return finger.feel_carrier(amplitude_v, rate / step, drive.frequency_hz, *along, start_s)

    steps = {"finger": feel_ideal(exact), "surface": feel_ideal(sent)}
    return steps | {"modulation": with_surface, "quantisation": quantised}


def _without_surface(known: Played, sent_v: Array, h0_m: float) -> Array:
    """Return the amplitudes at which the model has the friction of the surface at `sent_v`."""
    renderer, model = known.renderer, known.setting.model
    at_s = known.start_s + known.collected("sample") / renderer.sample_rate_hz
    true_n, axis = known.setting.path.at(at_s)[2], renderer.surface.normal_force_n
    force = true_n.clip(axis.low, axis.high)  # a lifted finger has none
    sample = renderer.surface.evaluate(torch.from_numpy(force), torch.from_numpy(sent_v))
    mend = (sample.status.cpu().numpy() == Status.OK) & (sent_v > 0) & (force == true_n)
    mu = sample.mu.cpu().numpy()
    hertz = None if renderer.surface.frequency_hz.is_absent else renderer.drive.frequency_hz
    exact = sent_v.copy()
    if mend.any():
        exact[mend] = exact_amplitude(model, mu[mend], force[mend], hertz, h0_m, sent_v[mend])
    return exact.clip(max=model.screen.max_voltage_v)


def exact_amplitude(
    model: ContactModel,
    mu: Array,
    normal_force_n: Array,
    frequency_hz: float | None,
    h0_m: float,
    near_v: Array,
) -> Array:
    """Amplitudes [V] by which the contact model gives `mu`, which is above that without voltage.

    By the secant method from amplitudes `near_v`; arrays have the shape (points,).
    """
    force, goal = torch.from_numpy(normal_force_n), torch.from_numpy(1 / mu)
    most = model.screen.max_voltage_v**2

    def miss(square: Tensor) -> Tensor:
        return 1 / model.solve(force, square.sqrt(), frequency_hz, h0_m).mu.cpu() - goal

    before = torch.from_numpy(near_v**2).clamp(1e-6, most)
    square = (before * 0.999).clamp(min=1e-6)
    miss_before, miss_now = miss(before), miss(square)
    for _ in range(_ITERATIONS):
        slope = (miss_now - miss_before) / (square - before)
        step = torch.where(slope < 0, -miss_now / slope, 0.0)
        before, miss_before = square, miss_now
        # A converged point would divide 0 by 0.
        square = torch.where(miss_now.abs() > 1e-13 * goal, square + step, square * (1 - 1e-12))
        square = square.clamp(1e-6, most)
        miss_now = miss(square)
    return np.asarray(square.sqrt().numpy())


@dataclass(frozen=True)
class Simulation(Displayed):
    """Result of a simulation: target, played samples and felt friction.

    Parameters
    ----------
    surface : FrictionSurface
        Model of finger and screen in the renderer.
    played : Played
        Samples that were sent and played.
    felt : Felt
        Friction that the virtual finger felt.
    target_mu, lowest_mu, highest_mu : ndarray, shape (samples,)
        Friction that the texture asks for under the true finger, and the reachable range, at the
        times of `felt`.
    is_reachable : ndarray of bool, shape (samples,)
        Whether the target is in that range. Without a touch panel, fades are left out as well.
    evaluation : Evaluation
        All errors together.
    parts : mapping of str to Evaluation
        Each of `PARTS`: what switching this source off changes, when those after it are off
        already. Empty without a touch panel.
    periods : Evaluation, optional
        Of a direct drive with a touch panel: mean friction over each of its periods, from one zero
        of the wave to the next, without the part of prediction. The part of the modulation
        beyond it is ripple.
    """

    surface: FrictionSurface
    played: Played
    felt: Felt
    target_mu: Array
    lowest_mu: Array
    highest_mu: Array
    is_reachable: npt.NDArray[np.bool_]
    evaluation: Evaluation
    parts: Mapping[str, Evaluation]
    periods: Evaluation | None = None

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw friction wanted and felt, and the reach, against time.

        Parameters
        ----------
        ax : Axes, optional
            Axes of matplotlib to draw into; without them, those of a new figure.

        Returns
        -------
        Axes
            The axes.
        """
        ax = axes_or_new(ax)
        t, low, high = self.felt.t_s, self.lowest_mu, self.highest_mu
        ax.fill_between(t, low, high, color="0.9", label="reachable at this force")
        ax.plot(t, self.target_mu, color="tab:orange", lw=3, label="target")
        ax.plot(t, self.felt.mu, color="tab:blue", lw=0.8, label="felt")
        room = 0.3 * (high.max() - low.min())
        ax.set(xlabel="time (s)", ylabel="friction coefficient")
        ax.set_ylim(low.min() - 0.05 * room, high.max() + room)
        ax.legend(loc="upper center", ncols=3, fontsize=8, columnspacing=1.2)
        return ax

    @cached_property
    def at_strongest(self) -> ContactState | None:
        """States of the path under its highest amplitudes; None where nothing was played."""
        played, rate = self.played, self.played.renderer.sample_rate_hz
        frequency = played.renderer.drive.frequency_hz
        # The amplitude of each period, where the finger presses and something is played.
        period = max(1, round(rate / frequency))
        volts = np.abs(played.drive_v)
        peaks = volts[: len(volts) // period * period].reshape(-1, period).max(axis=1)
        t_s = played.start_s + (np.arange(len(peaks)) + 0.5) * period / rate
        force = np.interp(t_s, self.felt.t_s, self.felt.normal_force_n)
        used = np.flatnonzero((peaks > 0) & (force >= LIFTED_BELOW_N))
        if len(used) == 0:
            return None
        # From the strongest on, thinned.
        strongest = used[np.argsort(peaks[used])[::-1]][:: max(1, len(used) // _LOOKED_AT)]
        model = self.setting.model
        volts = peaks[strongest].clip(max=model.screen.max_voltage_v)
        return model.solve(torch.from_numpy(force[strongest]), torch.from_numpy(volts), frequency)

    @property
    def pull_past_breakdown(self) -> float:
        """Largest share of the attraction past breakdown on the path, see `ContactState`."""
        state = self.at_strongest
        return 0.0 if state is None else float(state.pull_past_breakdown.max())

    @property
    def setting(self) -> Setting:
        """Finger, screen, texture, path and drive."""
        return self.played.setting


def simulate(
    setting: Setting,
    surface: FrictionSurface,
    panel: TouchPanel | None = None,
    settings: LiveSettings | None = None,
    address: str = "mock:",
    on_progress: Callable[[float], None] = lambda share: None,
) -> Simulation:
    """Move the virtual finger along a path on a texture.

    With a touch panel, the panel reports the path, late and sampled, and the renderer predicts. The
    finger feels the mock device's output, at the place where it truly is. Then each source of
    error is switched off in turn.

    Without one, the renderer knows the path, and friction follows the voltage at once. What is left
    is the error of the surface, the modulation and the device's 16 bits.

    Parameters
    ----------
    setting : Setting
        Finger, screen, texture, path and drive.
    surface : FrictionSurface
        Model of finger and screen in the renderer.
    panel : TouchPanel, optional
        How the screen senses the finger.
    settings : LiveSettings, optional
        How the renderer works.
    address : str
        A mock device, with its options.
    on_progress : callable
        Called with the share that is done.

    Raises
    ------
    InputError
        If the address is not that of a mock device, or a setting cannot be used.
    """
    settings = LiveSettings() if settings is None else settings
    played = known = play_known(
        setting, surface, settings, address, lambda share: on_progress(share / 4)
    )
    h0_m = setting.model.screen.h0_m if settings.h0_m is None else settings.h0_m
    finger = VirtualFinger(setting.model, h0_m=h0_m, has_response=panel is not None)
    steps: dict[str, Felt] = {}
    if panel is not None:
        played = play_live(setting, surface, panel, settings, address)
        on_progress(0.5)
        steps = felt_in_steps(known, finger, h0_m)
    felt = played.feel(finger)
    if panel is not None:
        steps["prediction"] = felt
    on_progress(0.9)
    low, high, target, reachable = _target(played, felt)
    if panel is None:
        reachable &= known.is_settled(felt.t_s)
    average_s = _averaged_over_s(played)
    parts: dict[str, Evaluation] = {}
    before, periods = target, None
    for name, step in steps.items():
        parts[name] = evaluate(step, before, reachable, average_s)
        before = step.mu
    if steps and isinstance(played.renderer.drive, DirectWave):
        known_felt, from_s = steps["quantisation"], known.start_s
        periods = evaluate(known_felt, target, reachable, average_s, from_s=from_s)
    evaluation = evaluate(felt, target, reachable, average_s)
    return Simulation(
        surface, played, felt, target, low, high, reachable, evaluation, parts, periods
    )


def evaluate_live(played: Played, left_out_s: Sequence[tuple[float, float]] = ()) -> Evaluation:
    """Return errors of a live renderer's output, as `simulate` does with a touch panel.

    Parameters
    ----------
    played : Played
        On any device, in real time or in steps.
    left_out_s : sequence of (float, float)
        Begin and end of spans that do not count, by the clock of the path [s].
    """
    felt = played.feel(VirtualFinger(played.setting.model))
    _, _, target, counts = _target(played, felt)
    for began_s, ended_s in left_out_s:
        counts &= ~((felt.t_s >= began_s) & (felt.t_s <= ended_s))
    return evaluate(felt, target, counts, _averaged_over_s(played))


def _averaged_over_s(played: Played) -> float:
    """A whole period of a slow drive, whose ripple is left out."""
    return max(FELT_WITHIN_S, 1 / played.renderer.drive.frequency_hz)


def _target(played: Played, felt: Felt) -> tuple[Array, Array, Array, npt.NDArray[np.bool_]]:
    """Return reachable range, target and whether it is reachable, at the times of `felt`."""
    axis = played.renderer.surface.normal_force_n
    force = felt.normal_force_n.clip(axis.low, axis.high)
    reachable, path = played.renderer.reachable, played.setting.path
    low, high = reachable(force, felt.speed_mm_per_s)
    evaluator = played.setting.texture.evaluator
    moved = (felt.t_s - played.start_s, *path.velocity_mm_per_s(felt.t_s), force)
    facts = facts_on(path, evaluator.react, played.start_s)
    motion = Motion.of(felt.x_mm, felt.y_mm, *moved, history=facts, reachable=reachable)
    target = np.asarray(as_mu(evaluator.target, evaluator.wanted(motion), low, high))
    slack = 1e-9 * high
    on_axis = force == felt.normal_force_n
    return low, high, target, on_axis & (target >= low - slack) & (target <= high + slack)


CASES = ((20.0, 0.2), (20.0, 0.8), (45.0, 0.4), (100.0, 0.2), (100.0, 0.8))
"""Speeds [mm/s] and normal forces [N] at which a texture is compared with its recording."""

WITHIN_DB = 1.0
"""How near the felt level of a band must be."""

_LEAD_MM = 10.0  # of a band's stroke, left out at the start, while the drive fades in
_STEP_S = 0.01  # between corners of the path
_FELT_HZ = 5_000.0  # the attraction is followed up to a fifth: the highest band


@dataclass(frozen=True)
class BandError:
    """Felt level of a texture's band against that of its recording, at a speed and a force."""

    speed_mm_per_s: float
    normal_force_n: float
    band: int
    """From 0; between ``BANDS_HZ[band]`` and the next."""
    recorded_db: float
    """Level of the felt changes of friction over the friction [dB]."""
    error_db: float

    @property
    def is_near(self) -> bool:
        """Whether it is within `WITHIN_DB`."""
        return abs(self.error_db) <= WITHIN_DB


def felt_errors(
    model: ContactModel,
    texture: Spectral,
    recorded: Sequence[Stretch],
    on_progress: Callable[[float], None] = lambda share: None,
) -> Iterator[BandError]:
    """Yield the error of each band that was recorded, at each speed and force.

    The finger feels the longest stroke of the recording as it is, and one tile of the texture as
    it repeats. One renderer plays both as relative changes of friction around one mean.
    """
    stretch = max(recorded, key=lambda stroke: stroke.length_mm)
    x = _LEAD_MM + stretch.step_mm * np.arange(len(stretch.change))
    profile = RecordedProfile(x, texture.mean + stretch.change, "contrast", beyond="hold")
    scene = {"normal_force_n": (0.2, 0.8), "frequency_hz": DEFAULT_CARRIER_HZ}
    surface, _ = cached_surface(model, scene, "0.02 JND")
    finger, known = VirtualFinger(model), Energies([stretch])
    for number, (speed, force) in enumerate(CASES, 1):
        recording = _felt(surface, finger, profile, stretch.length_mm, False, speed, force)
        repeated = _felt(surface, finger, texture, texture.tile_mm, True, speed, force)
        levels = decibels(recording), decibels(repeated)
        on_progress(number / len(CASES))
        for band in np.flatnonzero(np.isfinite(known.levels_db(speed))).tolist():
            recorded_db, given_db = float(levels[0][band]), float(levels[1][band])
            yield BandError(speed, force, band, recorded_db, given_db - recorded_db)


def _felt(
    surface: FrictionSurface,
    finger: VirtualFinger,
    what: Feelable,
    length_mm: float,
    is_periodic: bool,
    speed: float,
    force: float,
) -> Array:
    """Return energies of the relative changes of friction that a finger feels, shape (bands,)."""
    end_s = (_LEAD_MM + length_mm + 1) / speed
    t = np.append(np.arange(0.0, end_s, _STEP_S), end_s)
    path = Trajectory(t, speed * t, np.full_like(t, 5.0), np.full_like(t, force))
    setting = Setting(finger.model, what, path)
    played = play_known(setting, surface, LiveSettings(), "mock:", lambda share: None)
    mu = played.feel(finger, output_rate_hz=_FELT_HZ).mu
    first = round(_LEAD_MM / speed * _FELT_HZ)
    mu = mu[first : first + round(length_mm / speed * _FELT_HZ)]
    return band_energies(mu / mu.mean() - 1, _FELT_HZ, is_periodic)


def band_name(band: int) -> str:
    """Return the range of a band, such as ``10-17 Hz``."""
    return f"{BANDS_HZ[band]:.0f}-{BANDS_HZ[band + 1]:.0f} Hz"
