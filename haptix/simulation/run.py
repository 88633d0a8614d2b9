"""Play a texture to the virtual finger, without hardware."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import torch

from haptix.checks import Array
from haptix.motion import LIFTED_BELOW_N, Motion
from haptix.motion.block import facts_on
from haptix.render import DirectWave, LiveSettings
from haptix.simulation.parts import felt_in_steps
from haptix.simulation.played import Played, Setting, play_known, play_live
from haptix.surface import FrictionSurface
from haptix.texture import as_mu
from haptix.virtual_finger import (
    FELT_WITHIN_S,
    Evaluation,
    Felt,
    TouchPanel,
    VirtualFinger,
    evaluate,
)

_LOOKED_AT = 200  # periods of a path


@dataclass(frozen=True)
class Simulation:
    """Result of a simulation: target, played samples and felt friction.

    Parameters
    ----------
    surface : FrictionSurface
        What the renderer knew of finger and screen.
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
        of the wave to the next, without the part of prediction. What the part of the modulation
        has beyond it is ripple.
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

    @cached_property
    def pull_past_breakdown(self) -> float:
        """Largest share of the attraction that no gap bears, see `ContactState`, on the path."""
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
            return 0.0
        # From the strongest on, thinned.
        strongest = used[np.argsort(peaks[used])[::-1]][:: max(1, len(used) // _LOOKED_AT)]
        model = self.setting.model
        limit = min(model.screen.max_voltage_v, float(peaks.max()))
        state = model.solve(
            torch.from_numpy(force[strongest]),
            torch.from_numpy(peaks[strongest].clip(max=limit)),
            frequency,
        )
        return float(state.pull_past_breakdown.max())

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
    finger feels what the mock device plays, at the place where it truly is. Then each source of
    error is switched off in turn.

    Without one, the renderer knows the path, and friction follows the voltage at once. What is left
    is the error of the surface, the modulation and the device's 16 bits.

    Parameters
    ----------
    setting : Setting
        Finger, screen, texture, path and drive.
    surface : FrictionSurface
        What the renderer knows of finger and screen.
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
    steps = {}
    if panel is not None:
        played = play_live(setting, surface, panel, settings, address)
        on_progress(0.5)
        steps = felt_in_steps(known, finger, h0_m)
    felt = played.feel(finger)
    on_progress(0.9)
    low, high, target, reachable = _target(played, felt)
    if panel is None:
        reachable &= known.is_settled(felt.t_s)
    average_s = _averaged_over_s(played)
    parts: dict[str, Evaluation] = {}
    periods = None
    if steps:
        before = target
        if isinstance(played.renderer.drive, DirectWave):
            known_felt, from_s = steps["quantisation"], known.start_s
            periods = evaluate(known_felt, target, reachable, average_s, from_s=from_s)
        for name, step in {**steps, "prediction": felt}.items():
            parts[name] = evaluate(step, before, reachable, average_s)
            before = step.mu
    evaluation = evaluate(felt, target, reachable, average_s)
    return Simulation(
        surface, played, felt, target, low, high, reachable, evaluation, parts, periods
    )


def evaluate_live(played: Played, left_out_s: Sequence[tuple[float, float]] = ()) -> Evaluation:
    """Errors of what a live renderer played, as `simulate` with a touch panel has them.

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
    """Reachable range, friction asked for, and whether it is reachable, at the times of `felt`."""
    axis = played.renderer.surface.normal_force_n
    force = felt.normal_force_n.clip(axis.low, axis.high)
    low, high = played.renderer.reachable(force, felt.speed_mm_per_s)
    evaluator = played.setting.texture.evaluator
    velocity = played.setting.path.velocity_mm_per_s(felt.t_s)
    facts = facts_on(played.setting.path, evaluator.react, played.start_s)
    t_s = felt.t_s - played.start_s
    reachable = played.renderer.reachable
    motion = Motion.of(
        felt.x_mm, felt.y_mm, t_s, *velocity, force, history=facts, reachable=reachable
    )
    value = evaluator.wanted(motion)
    target = np.asarray(as_mu(evaluator.target, value, low, high))
    slack = 1e-9 * high
    on_axis = force == felt.normal_force_n
    return low, high, target, on_axis & (target >= low - slack) & (target <= high + slack)
