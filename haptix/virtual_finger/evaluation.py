"""How well felt friction follows its target under the true finger."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import numpy.typing as npt

from haptix.checks import Array, number, positive
from haptix.errors import InputError
from haptix.perception import WEBER_FRACTION, WeightedError, weighted_error
from haptix.report import Heading
from haptix.status import Status
from haptix.virtual_finger.sensing import Felt

FELT_WITHIN_S = 1e-3
"""Friction is averaged over this time: vibration is felt up to about 1 kHz (physics page, section
7)."""


@dataclass(frozen=True)
class Evaluation:
    """Error of felt friction against its target; NaN where no sample could be evaluated.

    A just-noticeable difference (JND) is ``weber_fraction * target mu``.
    """

    error_rms_mu: Annotated[float, Heading("rms [mu]", ".3g")]
    error_p95_mu: Annotated[float, Heading("p95 [mu]", ".3g")]
    error_max_mu: float
    bias_mu: float
    """Mean of felt minus target."""
    error_rms_jnd: float
    error_p95_jnd: Annotated[float, Heading("p95 [JND]", ".3g")]
    error_max_jnd: float
    samples: int
    """All samples. The counts below need not add up to it, since averaging drops the edges of each
    stretch."""
    evaluated: int
    still: int
    """Samples at which the finger stands or is lifted; not evaluated."""
    unreachable: int
    """Sliding samples without a target, or with one out of reach; not evaluated."""
    pull_in: int
    """Sliding samples at which the contact snaps in; not evaluated, since no friction is known."""
    breakdown: int
    """Sliding samples at which gap or insulator break down; evaluated as if they did not."""
    average_s: float
    weber_fraction: float
    by_frequency: WeightedError
    """Without the moving average: felt minus target over the JND, as the skin detects it."""

    @property
    def weighted_jnd(self) -> Annotated[float, Heading("weighted [JND]", ".3g")]:
        """The root mean square of that."""
        return self.by_frequency.rms_jnd

    @property
    def counts(self) -> str:
        """One line for people: how much of the path was evaluated."""
        seen, still, beyond = (
            f"{count / self.samples:.0%}"
            for count in (self.evaluated, self.still, self.unreachable)
        )
        return f"evaluated over {seen} of the path, still {still}, out of reach {beyond}"


def evaluate(
    felt: Felt,
    target_mu: npt.ArrayLike,
    is_reachable: npt.ArrayLike | None = None,
    average_s: float = FELT_WITHIN_S,
    weber_fraction: float = WEBER_FRACTION,
    from_s: float | None = None,
) -> Evaluation:
    """Compare what a finger felt with the target at the place where it truly was.

    Felt friction and target are averaged alike, over a moving window of `average_s`. A sample is
    evaluated if the finger slides in light contact, within reach, over the whole window.

    Parameters
    ----------
    felt : Felt
        Felt under any drive: the renderer's, or one with a source of error switched off.
    target_mu : array, shape (samples,)
        Friction coefficient asked for at `felt.x_mm`, `felt.y_mm` and `felt.normal_force_n`; NaN
        where there is none.
    is_reachable : array of bool, shape (samples,), optional
        Where the screen can reach the target; the default is everywhere.
    average_s : float
        Width of the window [s], 0 for none. Half a period of a direct drive, or a whole multiple
        of it, removes the ripple.
    weber_fraction : float
        JND over friction.
    from_s : float, optional
        Windows lie side by side from this time [s], instead of around each sample. On the periods
        of a direct drive they give the error of its mean friction alone: a moving window cuts
        through pulses of unlike height.

    Raises
    ------
    InputError
        If lengths differ, a target is not above 0, or a number is out of its range.
    """
    target = np.asarray(target_mu, dtype=np.float64)
    everywhere = np.ones(len(felt.t_s), dtype=bool)
    reachable = everywhere if is_reachable is None else np.asarray(is_reachable)
    for name, given in (("target_mu", target), ("is_reachable", reachable)):
        if given.shape != felt.t_s.shape:
            raise InputError(
                f"{name}: expected one value for each of the {len(felt.t_s)} times of felt.t_s, "
                f"got shape {given.shape}"
            )
    if reachable.dtype != np.bool_:
        raise InputError(f"is_reachable: expected bools, got {reachable.dtype}")
    has_target = ~np.isnan(target)
    if (target[has_target] <= 0).any() or np.isinf(target).any():
        raise InputError("target_mu: expected finite values above 0, or NaN")
    average = number("average_s", average_s, 0.0)
    if from_s is not None:
        positive("average_s", average_s)
        number("from_s", from_s)
    weber = positive("weber_fraction", weber_fraction)
    sliding = felt.is_sliding
    pull_in = sliding & (felt.status == Status.PULL_IN)
    within = sliding & reachable & has_target
    usable = within & ~pull_in
    step_s = float(felt.t_s[-1] - felt.t_s[0]) / (len(felt.t_s) - 1)
    if from_s is None:
        width = min(max(1, round(float(average) / step_s)), len(felt.t_s) + 1)
        whole, (averaged_felt, averaged_target) = _averaged(usable, width, felt.mu, target)
    else:
        window = np.floor((felt.t_s - from_s) / average).astype(np.int64)
        whole, (averaged_felt, averaged_target) = _side_by_side(usable, window, felt.mu, target)
    error = (averaged_felt - averaged_target)[whole]
    in_mu = _figures(np.abs(error))
    in_jnd = _figures(np.abs(error) / (weber * averaged_target[whole]))
    return Evaluation(
        *in_mu,
        float(error.mean()) if len(error) else np.nan,
        *in_jnd,
        samples=len(felt.t_s),
        evaluated=int(whole.sum()),
        still=int((~sliding).sum()),
        unreachable=int((sliding & ~within).sum()),
        pull_in=int(pull_in.sum()),
        breakdown=int((sliding & (felt.status == Status.BREAKDOWN)).sum()),
        average_s=float(average),
        weber_fraction=float(weber),
        by_frequency=weighted_error(
            (felt.mu - target) / (weber * np.where(usable, target, 1.0)), usable, 1.0 / step_s
        ),
    )


def _figures(size: Array) -> tuple[float, float, float]:
    """Rms, 95th percentile and largest."""
    if not len(size):
        return np.nan, np.nan, np.nan
    rms = np.sqrt(np.mean(size**2))
    return float(rms), float(np.percentile(size, 95)), float(size.max())


def _averaged(
    usable: npt.NDArray[np.bool_], width: int, *columns: Array
) -> tuple[npt.NDArray[np.bool_], list[Array]]:
    """Where a whole window is usable, and the mean of each column over each sample's window."""
    from scipy.ndimage import uniform_filter1d  # half a second of the live finger's start

    filled = (np.where(usable, column, 0.0) for column in columns)
    means = [uniform_filter1d(column, width, mode="constant") for column in filled]
    unusable = uniform_filter1d((~usable).astype(float), width, mode="constant", cval=1.0)
    return unusable < 0.5 / width, means


def _side_by_side(
    usable: npt.NDArray[np.bool_], window: npt.NDArray[np.int64], *columns: Array
) -> tuple[npt.NDArray[np.bool_], list[Array]]:
    """As `_averaged`, over the samples of one window number; those at the ends may not be whole."""
    window = window - window[0]
    count = np.bincount(window).clip(1)
    filled = (np.where(usable, column, 0.0) for column in columns)
    means = [(np.bincount(window, column) / count)[window] for column in filled]
    is_whole = np.bincount(window, ~usable) == 0
    is_whole[[0, -1]] = False
    return is_whole[window], means
