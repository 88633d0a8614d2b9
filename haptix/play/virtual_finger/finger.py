"""A virtual finger on a driven screen: friction along a path, or part by part as it is played."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import ceil, log
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch

from haptix.base import checks
from haptix.base.checks import Array
from haptix.base.display import Displayed
from haptix.base.errors import InputError, LimitError
from haptix.base.fields import LIFTED_BELOW_N
from haptix.base.threads import one_thread
from haptix.feel.motion import STANDING_BELOW_MM_PER_S, Trajectory
from haptix.model.electro import Circuit
from haptix.model.electro.attraction import Pull, representative_gaps
from haptix.model.fidelity import Ability
from haptix.model.finger import FingerResponse
from haptix.model.friction import ContactModel
from haptix.model.friction.placeholders import with_finger
from haptix.model.friction.solver import FrictionSolver
from haptix.model.status import Status, past_limits
from haptix.model.terms import Occlusion, SlidingSpeed
from haptix.play.virtual_finger.felt import Felt, SensedForce, SensorModel
from haptix.play.virtual_finger.squared_field import (
    Amplitude,
    ComplexArray,
    Drive,
    Excerpt,
    GapField,
    Samples,
)

_FINER = 4  # steps of the response in one of the output
PART_S = 10.0  # instants solved at once, which bounds the memory
_ROUNDING = 1e-4  # of the limit: a driver's 16 bits may read back this much above it
_FEWEST_SAMPLES = 4
_DRIVE_RATES_HZ = (100.0, 1e6)  # above those of existing drivers, and within memory
_LOWEST_RATE_HZ = 10.0
_MOST_SAMPLES = 20_000_000  # half an hour at 10 kHz, and a gigabyte
_SOFTENING_STEP = 0.25  # of ln E: mu is within 0.5 % between two
_LONG = 1e3  # time constants after which the skin is fully softened
_END = 1e-6  # of an output step: keeps a path's last sample when its time was rounded


class Sensed(NamedTuple):
    """Attraction along a path; arrays of shape (samples,) unless said."""

    t_s: Array
    x_mm: Array
    y_mm: Array
    normal_force_n: Array
    speed_mm_per_s: Array
    squares: Array
    """Squared field after the finger's response, shape (points, samples)."""
    status: npt.NDArray[np.int64]
    after: Array | None
    """Squared field one sample after the last."""
    contact_s: Array
    """Time since the finger came down [s]."""


class VirtualFinger(Displayed):
    """A finger that feels a driver's output, by the contact model alone.

    At each instant the gaps' field follows from the voltage's whole spectrum (complex h0 per
    frequency), its square is the attraction, the finger's first-order response smooths it over a
    slid distance, and the contact is in equilibrium with it. The derivation is in
    ``docs/virtual-finger.md``. Where the model has the terms "occlusion" and "sliding-speed", skin
    softens and friction follows the speed as along the path, not as at the finger's own values.

    Parameters
    ----------
    model : ContactModel
        Finger and screen; "mean-field" or "closed-form".
    sensor : SensorModel, optional
        What `read` measures with; the default is a perfect one.
    seed : int
        Seed of the sensor's noise.
    h0_m : float, optional
        Effective thickness of the insulator [m]; the default is the screen's own.
    has_response : bool
        False: friction follows the attraction at once, without the finger's first-order response.

    Raises
    ------
    InputError
        If a value is out of its range, or the model is solved by boundary elements.
    """

    def _shown(self) -> dict[str, Any]:
        return {"model": self.model, "seed": self.seed}

    def __init__(
        self,
        model: ContactModel,
        sensor: SensorModel | None = None,
        seed: int = 0,
        h0_m: float | None = None,
        has_response: bool = True,
    ) -> None:
        model.require(Ability.INSTANTS, "model")
        h0_m = checks.positive("h0_m", model.screen.h0_m if h0_m is None else h0_m)
        self.model = model
        self.sensor = SensorModel() if sensor is None else sensor
        self.seed = seed
        rate = model.finger.response_hz_per_mm_per_s
        self._response = FingerResponse(rate) if has_response else None
        self._softer: dict[int, FrictionSolver] = {}
        self._h0 = torch.tensor(h0_m, dtype=torch.float64, device=model.contact.device)

    def read(self, felt: Felt) -> SensedForce:
        """Return a sensor's readings of the felt friction."""
        return self.sensor.read(felt, self.seed)

    def feel(
        self,
        drive_v: npt.ArrayLike,
        sample_rate_hz: float,
        t_s: npt.ArrayLike,
        x_mm: npt.ArrayLike,
        y_mm: npt.ArrayLike,
        normal_force_n: npt.ArrayLike,
        start_s: float = 0.0,
        output_rate_hz: float = 10_000.0,
    ) -> Felt:
        """Feel a drive signal along a path.

        Parameters
        ----------
        drive_v : array, shape (samples,)
            Voltage played [V]; 0 V before its first and after its last sample.
        sample_rate_hz : float
            Rate of the drive's samples [Hz].
        t_s, x_mm, y_mm, normal_force_n : array, shape (touches,)
            The finger's true path: times [s], places [mm] and normal forces [N], 0 where lifted;
            all are linear in between. Place and force may be single numbers.
        start_s : float
            Time of the first sample of the drive, on the path's clock [s].
        output_rate_hz : float
            Rate of the result [Hz]; the attraction is followed up to a fifth of it.

        Returns
        -------
        Felt
            From the first time of the path to its last.

        Raises
        ------
        InputError
            If a value is not finite or out of its range, or the path's times do not increase.
        LimitError
            If the drive exceeds the screen's voltage limit.

        Examples
        --------
        >>> import haptix
        >>> model = haptix.ContactModel(
        ...     haptix.Finger.preset("wet"), haptix.Screen(), fidelity="closed-form"
        ... )
        >>> drive_v = np.zeros(4800)  # 0.1 s of nothing
        >>> felt = VirtualFinger(model).feel(drive_v, 48_000.0, [0.0, 0.1], [0.0, 5.0], 20.0, 0.5)
        >>> bool(abs(felt.mu / float(model.solve(0.5, 0.0).mu) - 1).max() < 1e-3)
        True
        """
        low, high = _DRIVE_RATES_HZ
        if not low <= sample_rate_hz <= high:
            raise InputError(
                f"sample_rate_hz: expected {low:g} to {high:g} Hz, got {sample_rate_hz:g} Hz"
            )
        played = self._played("drive_v", drive_v, sample_rate_hz, start_s)
        path = Trajectory.of(t_s, x_mm, y_mm, normal_force_n)
        return self._feel(Samples(*played, self._thickness_m), path, output_rate_hz)

    def feel_carrier(
        self,
        amplitude_v: npt.ArrayLike,
        sample_rate_hz: float,
        frequency_hz: float,
        t_s: npt.ArrayLike,
        x_mm: npt.ArrayLike,
        y_mm: npt.ArrayLike,
        normal_force_n: npt.ArrayLike,
        start_s: float = 0.0,
        output_rate_hz: float = 10_000.0,
    ) -> Felt:
        """Feel an ideal carrier of given amplitude: a drive whose modulation has no error.

        The result and the errors are those of `feel`.

        Parameters
        ----------
        amplitude_v : array, shape (samples,)
            Amplitude V0 [V] of the carrier, 0 or more; linear between samples, 0 V outside.
        sample_rate_hz, frequency_hz : float
            Rate of these samples, and the carrier's frequency [Hz].
        t_s, x_mm, y_mm, normal_force_n, start_s, output_rate_hz
            As in `feel`.
        """
        checks.positive("sample_rate_hz", sample_rate_hz)
        checks.positive("frequency_hz", frequency_hz)
        played = self._played("amplitude_v", amplitude_v, sample_rate_hz, start_s)
        if (lowest := played[0].min()) < 0:
            raise InputError(f"amplitude_v: expected 0 V or more, got {lowest:g} V")
        path = Trajectory.of(t_s, x_mm, y_mm, normal_force_n)
        return self._feel(Amplitude(*played, self.thickness_m(frequency_hz)), path, output_rate_hz)

    def thickness_m(self, frequency_hz: float) -> complex:
        """Effective thickness [m] of the insulators at a carrier's frequency.

        Examples
        --------
        >>> import haptix
        >>> model = haptix.ContactModel(haptix.Finger(), haptix.Screen())
        >>> abs(VirtualFinger(model).thickness_m(240.0)) > 0
        True
        """
        (thickness,) = self._thickness_m(np.array([float(frequency_hz)]))
        return complex(thickness)

    def _feel(self, drive: Drive, path: Trajectory, output_rate_hz: float) -> Felt:
        if not output_rate_hz >= _LOWEST_RATE_HZ:
            raise InputError(
                f"output_rate_hz: expected {_LOWEST_RATE_HZ:g} Hz or more, got {output_rate_hz:g}"
            )
        steps = path.duration_s * output_rate_hz
        if not 1 - _END <= steps < _MOST_SAMPLES:
            raise InputError(
                f"output_rate_hz: expected one that gives 2 to {_MOST_SAMPLES:g} samples, got "
                f"{output_rate_hz:g} Hz over the path's {path.duration_s:g} s; check the path's "
                "clock, or feel it in parts"
            )
        field = self.field_of(drive)
        sensed = self.sense(drive, field, path, int(steps + _END) + 1, output_rate_hz)
        return self.felt([sensed], field)[0]

    def field_of(self, drive: Drive) -> GapField:
        """Return the points that hold a drive in all gaps of the contact."""
        return drive.field(float(self.model.contact.gap_edges_m[-1]))

    def sense(
        self,
        drive: Drive,
        field: GapField,
        path: Trajectory,
        count: int,
        rate_hz: float,
        before: Array | None = None,
        contact_s: float = 0.0,
    ) -> Sensed:
        """Return the attraction at the first `count` instants of a path.

        Parameters
        ----------
        drive, field
            The drive, and the field that it makes in the gaps.
        path : Trajectory
            Where the finger is.
        count : int
            How many instants.
        rate_hz : float
            How many a second.
        before : array, optional
            The `after` of the part before, from which it goes on; by default rest.
        contact_s : float
            How long the finger has been down [s].
        """
        time = path.t_s[0] + np.arange(count) / rate_hz
        places = (*path.at(time), path.speed_mm_per_s(time))
        lifted = np.where(places[2] < LIFTED_BELOW_N, time, time[0] - contact_s)
        contact = time - np.maximum.accumulate(lifted)
        squares = self._squares(drive, field, path, count, rate_hz, before)
        return Sensed(time, *places, *squares, contact)

    def felt(self, parts: Sequence[Sensed], field: GapField) -> list[Felt]:
        """Return the friction under attractions; several are solved at once.

        Parameters
        ----------
        parts : sequence of Sensed
            What `sense` returned; several are solved at once.
        field : GapField
            The field that the drive makes in the gaps.
        """
        force = np.concatenate([part.normal_force_n for part in parts])
        speed = np.concatenate([part.speed_mm_per_s for part in parts])
        slides = (speed >= STANDING_BELOW_MM_PER_S) & (force >= LIFTED_BELOW_N)
        squares = np.concatenate([part.squares for part in parts], axis=1)
        reported = np.concatenate([part.status for part in parts])
        mu = np.full(len(force), np.nan)
        status = np.full(len(force), int(Status.OK))
        if slides.any():
            contact = np.concatenate([part.contact_s for part in parts])
            mu[slides], solved = self._friction_in_time(
                force[slides], squares[:, slides], field, contact[slides], speed[slides]
            )
            by_field = (reported[slides] != int(Status.OK)) & (solved != int(Status.PULL_IN))
            status[slides] = np.where(by_field, reported[slides], solved)
        friction_force_n = np.where(slides, mu * force, 0.0)
        ends = np.cumsum([len(part.t_s) for part in parts])[:-1]
        parted = (np.split(column, ends) for column in (mu, friction_force_n, status))
        return [
            Felt(part.t_s, part.x_mm, part.y_mm, part.speed_mm_per_s, part.normal_force_n, *columns)
            for part, columns in zip(parts, zip(*parted, strict=True), strict=True)
        ]

    def _played(
        self, name: str, value: npt.ArrayLike, sample_rate_hz: float, start_s: float
    ) -> tuple[Array, float, float]:
        """Checked volts, their rate and the time of the first."""
        volts = checks.row(name, value, _FEWEST_SAMPLES)
        limit = self.model.screen.max_voltage_v
        highest = float(np.abs(volts).max())
        if highest > limit * (1 + _ROUNDING):
            raise LimitError(
                f"{name}: {highest:g} V is above the limit of {limit:g} V of screen "
                f"{self.model.screen.name!r}; the drive must not exceed it"
            )
        return volts, float(sample_rate_hz), checks.number("start_s", start_s)

    def _squares(
        self,
        drive: Drive,
        field: GapField,
        path: Trajectory,
        count: int,
        rate_hz: float,
        before: Array | None,
    ) -> tuple[Array, npt.NDArray[np.int64], Array | None]:
        """Squared field after the response, (points, count), its status, and its end."""
        squares = np.empty((field.points, count))
        status = np.empty(count, dtype=np.int64)
        part = max(2, round(PART_S * rate_hz))
        for first in range(0, count, part):
            last = min(first + part, count)
            # One step of the output is shared with the next part, which goes on from there.
            steps = np.arange(first * _FINER, last * _FINER + 1)
            time = path.t_s[0] + steps / (_FINER * rate_hz)
            excerpt = drive.excerpt(float(time[0]), float(time[-1]))
            seen = excerpt.squares(field, time, rate_hz)
            if self._response is not None:
                seen = self._response.follow(seen, path.distance_mm(time), before)
                before = seen[:, -1]
            squares[:, first:last] = seen[:, :-1:_FINER]
            status[first:last] = self._status(excerpt, time[::_FINER])
        return squares, status, before

    def _thickness_m(self, frequency_hz: Array) -> ComplexArray:
        """Effective thickness [m] at frequencies [Hz] from 0."""
        frequency = torch.from_numpy(frequency_hz).to(self._h0.device)
        return self.model.solver.terms.thickness(self._h0, frequency).detach().cpu().numpy()

    def _friction_in_time(
        self, force: Array, squares: Array, field: GapField, contact_s: Array, speed: Array
    ) -> tuple[Array, npt.NDArray[np.int64]]:
        """Return friction coefficient and status at each instant, of the skin at that time."""
        terms, finger = self.model.terms, self.model.finger
        factor = np.ones_like(force)
        if SlidingSpeed.name in terms:  # the solver has that of the finger's own speed
            own_factor = SlidingSpeed.factor(finger, finger.sliding_speed_mm_per_s)
            factor = SlidingSpeed.factor(finger, speed) / own_factor
        least = log(finger.softened_share)
        if Occlusion.name not in terms or least == 0:
            return self._friction(self.model.solver, force, squares, field, factor)
        # Between skins of a few moduli, ln mu is linear in the logarithm of the modulus.
        nodes = ceil(-least / _SOFTENING_STEP)
        place = np.log(Occlusion.share(finger, contact_s)) / least * nodes
        low = np.floor(place).clip(0, nodes - 1).astype(int)
        mu, status = np.empty_like(force), np.empty(len(force), dtype=np.int64)
        for node in np.unique(low).tolist():
            at = low == node
            (stiff, of_stiff), (soft, of_soft) = (
                self._friction(solver, force[at], squares[:, at], field, factor[at])
                for solver in (self._softened(node + more, nodes) for more in (0, 1))
            )
            share = place[at] - node
            mu[at] = stiff * (soft / stiff) ** share
            status[at] = np.where(share < 0.5, of_stiff, of_soft)
        return mu, status

    def _softened(self, node: int, nodes: int) -> FrictionSolver:
        """Return the solver of a finger whose skin is softened by so many equal steps."""
        if node not in self._softer:
            finger = self.model.finger
            share = finger.softened_share ** (node / nodes)
            long_since = {"contact_time_s": _LONG * finger.softening_time_s}
            softer = finger.replace(softened_share=share, **long_since)
            self._softer[node] = with_finger(self.model, softer).solver
        return self._softer[node]

    @one_thread()
    def _friction(
        self,
        solver: FrictionSolver,
        normal_force_n: Array,
        squares: Array,
        field: GapField,
        factor: Array,
    ) -> tuple[Array, npt.NDArray[np.int64]]:
        """Return friction in equilibrium at each instant, and its status without the field's."""
        edges = self.model.contact.gap_edges_m
        force, weight = (
            torch.from_numpy(a.copy()).to(edges.device) for a in (normal_force_n, squares.T)
        )
        basis = field.basis_of_gaps(representative_gaps(edges).cpu().numpy())
        of_gap = torch.from_numpy(basis).to(edges.device)
        # By the insulators' own length: the drive has many frequencies, the circuit one division.
        reference = edges.new_tensor(field.reference_m)
        limit = solver.terms.field_limit()
        mu, solution = solver.solve_in_blocks(
            force,
            lambda at: replace(
                Pull.of_squares(edges, weight[at], of_gap, field.reference_m, limit),
                circuit=Circuit.of_one(reference, torch.ones_like(reference), len(weight[at])),
            ),
        )
        light = torch.where(solution.is_stable, int(Status.OK), int(Status.PULL_IN))
        pressure = solver.spot_pressure_pa(mu, solution)
        mu = mu * torch.from_numpy(factor).to(mu)
        status = past_limits(light, mu, pressure)
        return mu.detach().cpu().numpy(), status.cpu().numpy()

    def _status(self, excerpt: Excerpt, t_s: Array) -> npt.NDArray[np.int64]:
        """Return the status by the field alone, between each two times."""
        light = torch.ones(len(t_s) - 1, dtype=torch.bool)
        status = self.model.solver.terms.status(
            light, lambda gap_m: torch.from_numpy(excerpt.highest_field(gap_m, t_s))
        )
        return status.numpy()


class LiveVirtualFinger:
    """`VirtualFinger.feel_carrier` in consecutive parts.

    Parameters
    ----------
    finger : VirtualFinger
        Finger and screen.
    frequency_hz : float
        Of the carrier.
    rate_hz : float
        Of the felt friction.
    """

    def __init__(self, finger: VirtualFinger, frequency_hz: float, rate_hz: float = 1000.0) -> None:
        self._finger, self.rate_hz = finger, rate_hz
        self._thickness = finger.thickness_m(frequency_hz)
        self._field = finger.field_of(Amplitude(np.zeros(1), 1.0, 0.0, self._thickness))
        self._before: dict[int, Array | None] = {}
        self._end_s: dict[int, float] = {}
        self._contact_s: dict[int, float] = {}

    def feel(
        self,
        amplitude_v: Array,
        sample_rate_hz: float,
        start_s: float,
        paths: Mapping[int, Trajectory],
    ) -> dict[int, Felt]:
        """Return what fingers on several paths feel; the last time of a part begins the next one.

        Raises `InputError` if a path is shorter than a sample.

        Parameters
        ----------
        amplitude_v : ndarray, shape (samples,)
            Amplitude [V] of the carrier, linear between samples; 0 V outside.
        sample_rate_hz, start_s : float
            Rate of these samples, and time of the first.
        paths : mapping of int to Trajectory
            True path of each finger. One that does not begin where its part before ended begins
            from rest.
        """
        drive = Amplitude(amplitude_v, sample_rate_hz, start_s, self._thickness)
        sensed = {}
        for number, path in paths.items():
            count = round(path.duration_s * self.rate_hz)
            if count < 1:
                raise InputError(f"paths: expected {1 / self.rate_hz:g} s or more")
            goes_on = abs(self._end_s.get(number, -1.0) - path.t_s[0]) < 0.5 / self.rate_hz
            before = self._before.get(number) if goes_on else None
            contact_s = self._contact_s.get(number, 0.0) if goes_on else 0.0
            part = self._finger.sense(
                drive, self._field, path, count, self.rate_hz, before, contact_s
            )
            self._before[number] = part.after
            self._contact_s[number] = float(part.contact_s[-1]) + 1 / self.rate_hz
            self._end_s[number] = float(path.t_s[-1])
            sensed[number] = part
        if not sensed:
            return {}
        felt = self._finger.felt(list(sensed.values()), self._field)
        return dict(zip(sensed, felt, strict=True))
