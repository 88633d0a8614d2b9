"""Play a path to the virtual finger, and find what its error is made of."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt
import torch

from firmware_io import Device, open_device
from haptix.errors import InputError
from haptix.friction import ContactModel
from haptix.motion import Trajectory
from haptix.rehearsal.exact import exact_amplitude
from haptix.render import (
    DirectWave,
    Drive,
    LiveSettings,
    PredictingRenderer,
    Renderer,
    RenderSettings,
    RenderStats,
)
from haptix.status import Status
from haptix.surface import FrictionSurface
from haptix.texture import FrictionField, as_mu
from haptix.touch import TouchEvent
from haptix.virtual_finger import FELT_WITHIN_S, Felt, TouchPanel, Verdict, VirtualFinger, judge

Array = npt.NDArray[np.float64]

PARTS: Mapping[str, str] = {
    "finger": "what no drive can do: the finger's own response smooths friction over its way",
    "surface": "interpolation of the friction surface, against the contact model itself",
    "modulation": "the wave on the device's clock: against an ideal carrier of its amplitude; of a "
    "direct drive, friction over a period and the finger's response, against what was wanted",
    "quantisation": "the device's 16 bits, against real numbers",
    "prediction": "touches at the panel's rate, noise and latency, against the true path",
}
"""Sources of error. What a direct drive does to the finger is all in its modulation."""

_TRUTH_HZ = 1000.0  # of the touches that stand for the true path


@dataclass(frozen=True)
class Rehearsal:
    """What was played, felt and wanted.

    Parameters
    ----------
    felt : Felt
        By the virtual finger, from what the device played.
    wanted_mu : ndarray, shape (samples,)
        What the texture wants under the true finger, at the times of `felt`.
    is_reachable : ndarray of bool, shape (samples,)
        Whether the surface can give it.
    verdict : Verdict
        Of all errors together.
    parts : mapping of str to Verdict
        Of each of `PARTS`: what switching it off changes, when those after it are off already.
    stats : RenderStats
        Of the renderer.
    played_v : ndarray, shape (drive samples,)
        What the device played [V], from the time `start_s` on.
    sample_rate_hz, start_s : float
        Clock of the device.
    """

    felt: Felt
    wanted_mu: Array
    is_reachable: npt.NDArray[np.bool_]
    verdict: Verdict
    parts: Mapping[str, Verdict]
    stats: RenderStats
    played_v: Array
    sample_rate_hz: float
    start_s: float


def rehearse(
    model: ContactModel,
    surface: FrictionSurface,
    texture: FrictionField,
    path: Trajectory,
    panel: TouchPanel | None = None,
    drive: Drive | None = None,
    settings: LiveSettings | None = None,
    address: str = "mock:",
    on_progress: Callable[[float], None] = lambda share: None,
) -> Rehearsal:
    """Let the virtual finger move along a path on a texture.

    The touch panel reports the path, late and coarse; the renderer predicts and plays into a mock
    device; the finger feels what was played, by the contact model, at the place where it truly is.
    Then each source of error is switched off in turn.

    Parameters
    ----------
    model : ContactModel
        Finger and screen, as they truly are.
    surface : FrictionSurface
        What the renderer knows of them.
    texture : FrictionField
        What to feel.
    path : Trajectory
        Where the finger truly is.
    panel : TouchPanel, optional
        How the screen senses it: 100 Hz, 20 ms late, without noise.
    drive : Drive, optional
        Of the renderer.
    settings : LiveSettings, optional
        Of the renderer.
    address : str
        A mock device, with its options.
    on_progress : callable
        Called with the share that is done.

    Raises
    ------
    InputError
        If the address is no mock device's, or an option is wrong.
    """
    panel = TouchPanel() if panel is None else panel
    settings = LiveSettings() if settings is None else settings
    live = _play_live(surface, texture, path, panel, drive, settings, address)
    on_progress(0.2)
    known = _play_known(surface, texture, path, drive, settings, address)
    on_progress(0.4)
    finger = VirtualFinger(model, h0_m=_h0_m(model, settings))
    along = (path.t_s, path.x_mm, path.y_mm, path.normal_force_n)
    rate = live.renderer.sample_rate_hz
    frequency = live.renderer.drive.frequency_hz

    def feel(played: _Played, drive_v: Array) -> Felt:
        return finger.feel(_at_least_four(drive_v), rate, *along, played.start_s)

    step = known.renderer.blocks[0].step
    sent = np.concatenate([block.amplitude_v for block in known.renderer.blocks])
    exact = _without_surface(model, known, sent, path, _h0_m(model, settings))
    sent_v = np.concatenate([block.drive_v for block in known.renderer.blocks])
    played = {
        "quantisation": feel(known, known.played_v),
        "prediction": feel(live, live.played_v),
    }
    carrier = known.renderer.drive
    if isinstance(carrier, DirectWave):
        points = np.arange(len(exact) + 1) * step
        line = np.interp(np.arange(len(sent_v)), points, np.append(0.0, exact))
        limit = model.screen.max_voltage_v
        felt = {
            "modulation": feel(known, carrier.modulate(line, 0, rate).clip(-limit, limit)),
            "surface": feel(known, sent_v),
            **played,
        }
    else:
        start_s = known.start_s + step / rate

        def feel_ideal(amplitude_v: Array) -> Felt:
            return finger.feel_carrier(amplitude_v, rate / step, frequency, *along, start_s)

        felt = {
            "finger": feel_ideal(exact),
            "surface": feel_ideal(sent),
            "modulation": feel(known, sent_v),
            **played,
        }
    on_progress(0.9)
    wanted, reachable = _wanted(live.renderer, texture, felt["prediction"])
    average_s = 1 / frequency if isinstance(carrier, DirectWave) else FELT_WITHIN_S
    parts = {}
    against = wanted
    for name in felt:
        parts[name] = judge(felt[name], against, reachable, average_s)
        against = felt[name].mu
    return Rehearsal(
        felt=felt["prediction"],
        wanted_mu=wanted,
        is_reachable=reachable,
        verdict=judge(felt["prediction"], wanted, reachable, average_s),
        parts=parts,
        stats=live.renderer.stats,
        played_v=live.played_v,
        sample_rate_hz=rate,
        start_s=live.start_s,
    )


@dataclass(frozen=True)
class _Played:
    renderer: Renderer | PredictingRenderer
    played_v: Array
    start_s: float


def _mock(address: str) -> Device:
    device = open_device(address)
    if device.mock is None:
        device.close()
        raise InputError(f"device: expected a mock device, whose output can be felt, got {address}")
    return device


def _play_live(
    surface: FrictionSurface,
    texture: FrictionField,
    path: Trajectory,
    panel: TouchPanel,
    drive: Drive | None,
    settings: LiveSettings,
    address: str,
) -> _Played:
    seen = panel.read(path.t_s, path.x_mm, path.y_mm, path.normal_force_n)
    device = _mock(address)
    with PredictingRenderer(surface, texture, device, drive, settings) as renderer:
        for t, arrival, x, y, force in zip(
            *(c.tolist() for c in (seen.t_s, seen.arrival_s, seen.x_mm, seen.y_mm)),
            seen.normal_force_n.tolist(),
            strict=True,
        ):
            renderer.event(TouchEvent(t, 0, x, y, "move", force), arrival)
    return _played(renderer, device, float(seen.t_s[0]))


def _play_known(
    surface: FrictionSurface,
    texture: FrictionField,
    path: Trajectory,
    drive: Drive | None,
    settings: LiveSettings,
    address: str,
) -> _Played:
    """Play the true path, without panel, latency and prediction."""
    device = _mock(address)
    names = [field.name for field in fields(RenderSettings)]
    recorded = RenderSettings(**{name: getattr(settings, name) for name in names})
    recorded = replace(recorded, keep_blocks=True)
    count = int(path.duration_s * _TRUTH_HZ) + 2
    t = np.linspace(path.t_s[0], path.t_s[-1], count)
    with Renderer(surface, texture, device, drive, recorded) as renderer:
        renderer.play(Trajectory(t, *path.at(t)))
    return _played(renderer, device, float(path.t_s[0]))


def _played(renderer: Renderer | PredictingRenderer, device: Device, start_s: float) -> _Played:
    assert device.mock is not None
    played = np.array(device.mock.played_v)
    device.close()
    return _Played(renderer, played, start_s)


def _without_surface(
    model: ContactModel, known: _Played, sent_v: Array, path: Trajectory, h0_m: float
) -> Array:
    """Amplitudes by which the model gives the friction that the surface gives by `sent_v`."""
    surface, renderer = known.renderer.surface, known.renderer
    sample = np.concatenate([block.sample for block in known.renderer.blocks])
    force = path.at(known.start_s + sample / renderer.sample_rate_hz)[2]
    found = surface.evaluate(torch.from_numpy(force), torch.from_numpy(sent_v))
    mends = (found.status.numpy() == Status.OK) & (sent_v > 0)
    exact = sent_v.copy()
    if mends.any():
        frequency = None if surface.frequency_hz.is_absent else renderer.drive.frequency_hz
        exact[mends] = exact_amplitude(
            model, found.mu.numpy()[mends], force[mends], frequency, h0_m, sent_v[mends]
        )
    return exact.clip(max=model.screen.max_voltage_v)


def _wanted(
    renderer: Renderer | PredictingRenderer, texture: FrictionField, felt: Felt
) -> tuple[Array, npt.NDArray[np.bool_]]:
    axis = renderer.surface.normal_force_n
    force = felt.normal_force_n.clip(axis.low, axis.high)
    low, high = renderer.reachable(force, felt.speed_mm_per_s)
    wanted = np.asarray(as_mu(texture.target, texture.friction(felt.x_mm, felt.y_mm), low, high))
    on_axis = force == felt.normal_force_n
    slack = 1e-9 * high
    return wanted, on_axis & (wanted >= low - slack) & (wanted <= high + slack)


def _h0_m(model: ContactModel, settings: LiveSettings) -> float:
    return model.screen.h0_m if settings.h0_m is None else settings.h0_m


def _at_least_four(drive_v: Array) -> Array:
    return drive_v if len(drive_v) >= 4 else np.append(drive_v, np.zeros(4))
