"""How well felt friction follows what was wanted under the true finger."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter1d

from haptix.errors import InputError
from haptix.motion import numbers
from haptix.perception import WEBER_FRACTION
from haptix.status import Status
from haptix.virtual_finger.felt import Felt

Array = npt.NDArray[np.float64]

FELT_WITHIN_S = 1e-3
"""Friction is averaged over this time: vibration is felt up to some 1 kHz (physics page, section
7)."""


@dataclass(frozen=True)
class Verdict:
    """Error of felt friction against the wanted one; NaN where no sample could be judged.

    Thresholds are differences over ``weber_fraction * wanted mu``: 1 is just felt by a finger.
    """

    error_rms_mu: float
    error_p95_mu: float
    error_max_mu: float
    bias_mu: float
    """Mean of felt less wanted."""
    error_rms_thresholds: float
    error_p95_thresholds: float
    error_max_thresholds: float
    samples: int
    """All samples; those below need not add up to it, since the edges of each stretch are lost to
    the averaging."""
    judged: int
    still: int
    """Samples at which the finger stands or is lifted: not judged."""
    unreachable: int
    """Sliding samples whose wanted friction is none, or said to be out of reach: not judged."""
    pull_in: int
    """Sliding samples at which the contact snaps in: not judged, since no friction is known."""
    breakdown: int
    """Sliding samples at which gap or insulator break down: judged, as if without sparks."""
    average_s: float
    weber_fraction: float

    @property
    def share_judged(self) -> float:
        """Judged samples over all."""
        return self.judged / self.samples


def judge(
    felt: Felt,
    wanted_mu_at_true_position: npt.ArrayLike,
    is_reachable: npt.ArrayLike | None = None,
    average_s: float = FELT_WITHIN_S,
    weber_fraction: float = WEBER_FRACTION,
) -> Verdict:
    """Compare what a finger felt with what was wanted at the place where it truly was.

    Felt and wanted friction are averaged alike, over a moving window of `average_s`; a sample is
    judged where the finger slides in light contact, within reach, over the whole window.

    Parameters
    ----------
    felt : Felt
        Felt under any drive: the whole renderer's, or one with a source of error switched off.
    wanted_mu_at_true_position : array, shape (samples,)
        Wanted friction coefficient at `felt.x_mm`, `felt.y_mm` and `felt.normal_force_n`; NaN where
        none is wanted.
    is_reachable : array of bool, shape (samples,), optional
        Where the screen can reach it; everywhere without.
    average_s : float
        Width of the window [s], 0 for none. Half a period of a direct drive, or whole multiples of
        it, takes its ripple out.
    weber_fraction : float
        Smallest relative difference that is felt.

    Raises
    ------
    InputError
        If lengths differ, a wanted friction is not above 0, or a number is out of its range.
    """
    wanted = np.asarray(wanted_mu_at_true_position, dtype=np.float64)
    reachable = np.ones(len(felt.t_s), dtype=bool)
    if is_reachable is not None:
        reachable = np.asarray(is_reachable)
    for name, given in (("wanted_mu_at_true_position", wanted), ("is_reachable", reachable)):
        if given.shape != felt.t_s.shape:
            raise InputError(
                f"{name}: expected one value for each of the {len(felt.t_s)} times of felt.t_s, "
                f"got shape {given.shape}"
            )
    if reachable.dtype != np.bool_:
        raise InputError(f"is_reachable: expected bools, got {reachable.dtype}")
    is_wanted = ~np.isnan(wanted)
    if (wanted[is_wanted] <= 0).any() or np.isinf(wanted).any():
        raise InputError("wanted_mu_at_true_position: expected finite values above 0, or NaN")
    (average,), (weber,) = (
        numbers("average_s", average_s),
        numbers("weber_fraction", weber_fraction),
    )
    if average < 0 or weber <= 0:
        raise InputError(
            "expected average_s of 0 or more and weber_fraction above 0, got "
            f"{average:g} s and {weber:g}"
        )
    sliding = felt.is_sliding
    pull_in = sliding & (felt.status == Status.PULL_IN)
    within = sliding & reachable & is_wanted
    usable = within & ~pull_in
    step_s = float(felt.t_s[-1] - felt.t_s[0]) / (len(felt.t_s) - 1)
    width = min(max(1, round(float(average) / step_s)), len(felt.t_s) + 1)
    whole, (felt_mu, wanted_mu) = _averaged(usable, width, felt.mu, wanted)
    error = (felt_mu - wanted_mu)[whole]
    in_mu = _figures(np.abs(error))
    in_thresholds = _figures(np.abs(error) / (weber * wanted_mu[whole]))
    return Verdict(
        *in_mu,
        float(error.mean()) if len(error) else np.nan,
        *in_thresholds,
        samples=len(felt.t_s),
        judged=int(whole.sum()),
        still=int((~sliding).sum()),
        unreachable=int((sliding & ~within).sum()),
        pull_in=int(pull_in.sum()),
        breakdown=int((sliding & (felt.status == Status.BREAKDOWN)).sum()),
        average_s=float(average),
        weber_fraction=float(weber),
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
    """Where a whole window is usable, and the columns' means over the window of each sample."""
    filled = (np.where(usable, column, 0.0) for column in columns)
    means = [uniform_filter1d(column, width, mode="constant") for column in filled]
    lacking = uniform_filter1d((~usable).astype(float), width, mode="constant", cval=1.0)
    return lacking < 0.5 / width, means
