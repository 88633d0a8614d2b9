"""Friction felt by a virtual finger, its sensors' readings, and the error against a target."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt

from haptix.base.checks import Array, NotNegative, Number, Positive, checked, number, positive
from haptix.base.display import Displayed, Table
from haptix.base.errors import InputError
from haptix.base.fields import LIFTED_BELOW_N
from haptix.base.report import Heading
from haptix.feel.motion import Trajectory
from haptix.model.perception.thresholds import WEBER_FRACTION, WeightedError, weighted_error
from haptix.model.status import Status


@dataclass(frozen=True)
class Felt(Table):
    """Felt friction; arrays of shape (samples,), evenly spaced in time."""

    t_s: Array
    """Time [s], on the clock of the path."""
    x_mm: Array
    y_mm: Array
    """True place of the finger [mm]."""
    speed_mm_per_s: Array
    """Sliding speed [mm/s]."""
    normal_force_n: Array
    """Normal force [N]."""
    mu: Array
    """Friction coefficient; NaN where the finger stands or is lifted, since nothing slides."""
    friction_force_n: Array
    """Friction force against the motion [N]; 0 where nothing slides, since static friction equals a
    push that is not known."""
    status: npt.NDArray[np.int64]
    """`haptix.Status`: `PULL_IN` where the contact snaps in (values at the branch's end),
    `BREAKDOWN` where that term is on and the field too high, else `OK`."""

    @property
    def is_sliding(self) -> npt.NDArray[np.bool_]:
        """Whether the finger slides, so that there is friction."""
        return np.isfinite(self.mu)


Axis = Literal["motion", "x", "y"]


@dataclass(frozen=True)
class SensedForce(Displayed):
    """Readings; arrays of shape (samples,)."""

    t_s: Array
    """Time at which the reading arrived [s]."""
    tangential_force_n: Array
    """Tangential force [N]."""
    normal_force_n: Array
    """Normal force [N]."""


@checked()
class SensorModel:
    """Noise, drift, crosstalk, offset, sign and latency of a two-axis force sensor.

    Parameters
    ----------
    force_noise_n : float
        Standard deviation of each reading of either force [N]: white, normal.
    drift_n_per_s : float
        Rise of the tangential reading [N/s], from the first sample on.
    crosstalk : float
        Share of each force that shows in the other's reading.
    offset_n : float
        Tangential reading without load [N].
    tangential_sign : int
        1, or -1 for a sensor mounted the other way round.
    latency_s : float
        Age of the force when its reading arrives [s]. Readings from before the first sample have
        the force of the first sample.
    axis : {"motion", "x", "y"}
        The tangential force along the motion, always positive; or the component along an axis of
        the screen of the force with which the finger drags it, positive towards larger x or y.

    Examples
    --------
    >>> SensorModel(force_noise_n=0.002).force_noise_n
    0.002
    """

    force_noise_n: NotNegative = 0.0
    drift_n_per_s: Number = 0.0
    crosstalk: Number = 0.0
    offset_n: Number = 0.0
    tangential_sign: Literal[1, -1] = 1
    latency_s: NotNegative = 0.0
    axis: Axis = "motion"

    def read(self, felt: Felt, seed: int = 0) -> SensedForce:
        """Read the felt friction; the same seed gives the same noise.

        Parameters
        ----------
        felt : Felt
            Felt friction.
        seed : int
            Seed of the noise: the same gives the same noise.
        """
        then = felt.t_s - self.latency_s
        tangential = np.interp(then, felt.t_s, self._tangential(felt))
        normal = np.interp(then, felt.t_s, felt.normal_force_n)
        noise = np.random.default_rng(seed).normal(0.0, self.force_noise_n, (2, len(felt.t_s)))
        drift = self.drift_n_per_s * (felt.t_s - felt.t_s[0])
        read = self.tangential_sign * tangential + self.crosstalk * normal + self.offset_n + drift
        return SensedForce(
            t_s=felt.t_s,
            tangential_force_n=read + noise[0],
            normal_force_n=normal + self.crosstalk * tangential + noise[1],
        )

    def _tangential(self, felt: Felt) -> Array:
        if self.axis == "motion":
            return felt.friction_force_n
        step_x, step_y = np.gradient(felt.x_mm), np.gradient(felt.y_mm)
        size = np.hypot(step_x, step_y)
        along = step_x if self.axis == "x" else step_y
        share = np.divide(along, size, out=np.zeros_like(size), where=size > 0)
        return np.asarray(felt.friction_force_n * share)


@dataclass(frozen=True)
class SensedTouch(Displayed):
    """Reports while the finger touches; arrays of shape (reports,)."""

    t_s: Array
    """Time at which the panel scanned [s]."""
    arrival_s: Array
    """Time at which the report arrives, `latency_s` later [s]."""
    x_mm: Array
    y_mm: Array
    """Reported place [mm]."""
    normal_force_n: Array
    """Reported normal force [N], above 0."""


@checked()
class TouchPanel:
    """Rate, latency and noise of a touch panel with a force axis.

    Parameters
    ----------
    rate_hz : float
        Reports per second; panels give 60 to 240 (physics page, section 7).
    latency_s : float
        From the scan to the arrival of its report [s]; 14 to 30 ms are usual.
    place_noise_mm, force_noise_n : float
        Standard deviation of each coordinate and of the force: white, normal.
    resolution_mm : float
        Step of the reported place; 0 for none.
    """

    rate_hz: Positive = 100.0
    latency_s: NotNegative = 0.02
    place_noise_mm: NotNegative = 0.0
    force_noise_n: NotNegative = 0.0
    resolution_mm: NotNegative = 0.0

    def read(self, path: Trajectory, seed: int = 0) -> SensedTouch:
        """Report a true path; the same seed gives the same noise.

        Parameters
        ----------
        path : Trajectory
            The true path.
        seed : int
            Seed of the noise: the same gives the same noise.
        """
        scans = int(path.duration_s * self.rate_hz + 1e-6) + 1
        time = path.t_s[0] + np.arange(scans) / self.rate_hz
        x, y, force = path.at(time)
        random = np.random.default_rng(seed)
        place = np.stack([x, y]) + random.normal(0.0, self.place_noise_mm, (2, len(time)))
        if self.resolution_mm:
            place = np.rint(place / self.resolution_mm) * self.resolution_mm
        noisy = force + random.normal(0.0, self.force_noise_n, len(time))
        touching = (force >= LIFTED_BELOW_N) & (noisy > 0)
        return SensedTouch(
            t_s=time[touching],
            arrival_s=time[touching] + self.latency_s,
            x_mm=place[0, touching],
            y_mm=place[1, touching],
            normal_force_n=noisy[touching],
        )


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
        """Its root mean square."""
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
    """Compare felt friction with the target at the finger's true place.

    Felt friction and target are averaged alike, over a moving window of `average_s`. A sample is
    evaluated if the finger slides in light contact, within reach, over the whole window.

    Parameters
    ----------
    felt : Felt
        Felt under any drive: the renderer's, or one with a source of error switched off.
    target_mu : array, shape (samples,)
        Wanted friction coefficient at `felt.x_mm`, `felt.y_mm` and `felt.normal_force_n`; NaN
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
    for name, values in (("target_mu", target), ("is_reachable", reachable)):
        if values.shape != felt.t_s.shape:
            raise InputError(
                f"{name}: expected one value for each of the {len(felt.t_s)} times of felt.t_s, "
                f"got shape {values.shape}"
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
    """Return where a whole window is usable, and each column's mean over each sample's window."""
    from scipy.ndimage import uniform_filter1d  # half a second of the live finger's start

    filled = (np.where(usable, column, 0.0) for column in columns)
    means = [uniform_filter1d(column, width, mode="constant") for column in filled]
    unusable = uniform_filter1d((~usable).astype(float), width, mode="constant", cval=1.0)
    return unusable < 0.5 / width, means


def _side_by_side(
    usable: npt.NDArray[np.bool_], window: npt.NDArray[np.int64], *columns: Array
) -> tuple[npt.NDArray[np.bool_], list[Array]]:
    """Like `_averaged`, over samples of one window number; windows at the ends may be shorter."""
    window = window - window[0]
    count = np.bincount(window).clip(1)
    filled = (np.where(usable, column, 0.0) for column in columns)
    means = [(np.bincount(window, column) / count)[window] for column in filled]
    is_whole = np.bincount(window, ~usable) == 0
    is_whole[[0, -1]] = False
    return is_whole[window], means
