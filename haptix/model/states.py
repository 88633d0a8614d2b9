"""Results of the contact model, for states and for one period of a drive; checks of its inputs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from haptix.base.display import Displayed, Table, as_numpy, axes_or_new
from haptix.base.errors import InputError, from_extra
from haptix.model.contact import Accuracy, beyond_validation
from haptix.model.status import limits_passed

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class GapSums(Displayed):
    """Sums over the gap distribution of solved states, of the shape of the states.

    The properties of `ContactState` describe them.
    """

    pull_past_breakdown: Tensor
    capacitance_f: Tensor
    conductance_s: Tensor
    current_a: Tensor | None


def _itself(value: Any) -> Any:
    return value


def _state_of(values: dict[str, Any]) -> ContactState:
    return ContactState(**values)


@dataclass(frozen=True)
class ContactState(Displayed):
    """Solved states; every tensor has the broadcast shape of the inputs.

    Where `status` is `Status.PULL_IN` there is no light contact: the values are those at its end.
    """

    mu: Tensor
    """Friction coefficient, ``tau_f A / F_N``, at a period's mean attraction: that of a carrier,
    which a contact is too slow to follow. For a slow drive use `ContactModel.over_period`."""
    x: Tensor
    """``p0/(E* slope)``, with the slope of all waves: how lightly the contact is loaded."""
    rolloff_waves: Tensor
    """Waves of the roll-off under the contact, ``A0 (q_r/2 pi)^2``."""
    area_fraction: Tensor
    """Real over apparent contact area, A/A0."""
    pressure_pa: Tensor
    """Effective pressure p that the contact carries."""
    gap_attraction_pa: Tensor
    """Time-averaged attraction of the open gaps."""
    spot_attraction_pa: Tensor
    """Time-averaged attraction inside the contact spots."""
    mean_gap_m: Tensor
    """Mean separation of the surfaces."""
    pull_in_voltage_v: Tensor
    """Amplitude at which the light contact ends."""
    peak_field_v_per_m: Tensor
    """Field at the edge of a contact spot, the highest in any gap."""
    breakdown_voltage_v: Tensor
    """Amplitude from which gap or insulator break down; a status where that term is on."""
    spot_pressure_pa: Tensor
    """Mean pressure in the contact spots: normal force and attraction over the real area."""
    find_status: Callable[[], Tensor] = field(repr=False, compare=False)
    find_accuracy: Callable[[], Accuracy] = field(repr=False, compare=False)
    find_yielded_area: Callable[[], Tensor] = field(repr=False, compare=False)
    sum_gaps: Callable[[], GapSums] = field(repr=False, compare=False)
    """These make the values of the properties below at their first use: many callers need none."""
    of_finger: tuple[str, ...] = field(default=(), repr=False, compare=False)
    """Warnings of the finger's measured roughness."""

    @cached_property
    def status(self) -> Tensor:
        """Integers of `Status`: OK only within all of `haptix.model.status.LIMITS`."""
        return self.find_status()

    @cached_property
    def accuracy(self) -> Accuracy:
        """Intervals of mu and of mu(V)/mu(0) that boundary elements showed for the theory."""
        return self.find_accuracy()

    def __reduce__(self) -> Any:
        """Pickle all values, those of the properties too: a process of a pool can return states."""
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        values |= {
            "find_status": partial(_itself, self.status),
            "find_accuracy": partial(_itself, self.accuracy),
            "find_yielded_area": partial(_itself, self.find_yielded_area()),
            "sum_gaps": partial(_itself, self._sums),
        }
        return _state_of, (values,)

    def plot(self, ax: Axes | None = None, quantity: str = "mu", **along: Any) -> Axes:
        """Draw a quantity against one of the inputs, a line for each row of the other ones.

        Parameters
        ----------
        ax : Axes, optional
            Axes of matplotlib to draw into; without them, those of a new figure.
        quantity : str
            Quantity to draw, such as ``"mu"`` or ``"area_fraction"``.
        **along
            The input of the last axis of the states, such as ``voltage_v=[0, 100, 200]``.

        Returns
        -------
        Axes
            The axes.

        Raises
        ------
        InputError
            If there is no such quantity, or `along` is not one input as long as the last axis.

        Examples
        --------
        >>> import haptix
        >>> model = haptix.ContactModel(haptix.Finger.preset("wet"), haptix.Screen())
        >>> volts = [0.0, 50.0, 100.0]
        >>> from matplotlib.figure import Figure
        >>> axes = model.solve(0.5, volts).plot(Figure().subplots(), voltage_v=volts)
        >>> axes.get_xlabel(), axes.get_ylabel()
        ('voltage_v', 'mu')
        """
        values = getattr(self, quantity, None)
        if not isinstance(values, Tensor):
            raise InputError(f"quantity: expected a tensor of the states, got {quantity!r:.40}")
        rows = values.detach().cpu().reshape(-1, values.shape[-1] if values.ndim else 1)
        ((name, numbers),) = along.items() if len(along) == 1 else (("", ()),)
        if np.size(numbers) != rows.shape[1]:
            raise InputError(
                f"plot: expected one input of {rows.shape[1]} numbers, such as voltage_v=[...], "
                f"got {', '.join(along) or 'none'}"
            )
        ax = axes_or_new(ax)
        ax.plot(np.ravel(numbers), rows.T)
        ax.set(xlabel=name, ylabel=quantity)
        return ax

    def to_xarray(self, **along: Any) -> xarray.Dataset:
        """Return all quantities as named arrays (extra ``netcdf``); ``to_dataframe`` is pandas'.

        Parameters
        ----------
        **along
            The input of each axis of the states, in their order, such as
            ``normal_force_n=[0.5, 1], voltage_v=[0, 50, 100]``.

        Raises
        ------
        InputError
            If the inputs are not as many and as long as the axes.
        MissingExtraError
            If xarray is not installed.

        Examples
        --------
        >>> import haptix
        >>> model = haptix.ContactModel(haptix.Finger.preset("wet"), haptix.Screen())
        >>> forces, volts = [0.5, 1.0], [0.0, 50.0, 100.0]
        >>> states = model.solve([[force] for force in forces], volts)
        >>> table = states.to_xarray(normal_force_n=forces, voltage_v=volts)
        >>> dict(table["mu"].sizes), len(table.to_dataframe())
        ({'normal_force_n': 2, 'voltage_v': 3}, 6)
        """
        with from_extra("netcdf"):
            import xarray
        shape = tuple(np.size(values) for values in along.values())
        if shape != tuple(self.mu.shape):
            raise InputError(
                f"to_xarray: expected the input of each axis, of lengths {tuple(self.mu.shape)}, "
                f"got {', '.join(along) or 'none'} of {shape}"
            )
        quantities = {**self._shown(), "status": self.status}
        arrays = {name: (tuple(along), as_numpy(quantity)) for name, quantity in quantities.items()}
        return xarray.Dataset(arrays, {name: np.ravel(values) for name, values in along.items()})

    def warnings(self) -> list[str]:
        """Name the states below the validated range or past a limit, as outputs quote it."""
        yielded = self.find_yielded_area()
        fewest = float(self.rolloff_waves.detach().min())
        beyond = beyond_validation(self.x.detach(), yielded, fewest)
        return [*beyond, *limits_passed(self.status), *self.of_finger]

    @property
    def attraction_pa(self) -> Tensor:
        """Total time-averaged attraction, gaps and spots."""
        return self.gap_attraction_pa + self.spot_attraction_pa

    @property
    def pull_past_breakdown(self) -> Tensor:
        """Share of the gaps' attraction that comes from gaps whose field exceeds what they bear.

        Such gaps spark or leak: above a half, friction is likely to be lower than predicted.
        """
        return self._sums.pull_past_breakdown

    @property
    def capacitance_f(self) -> Tensor:
        """Capacitance of one finger's contact [F], ``Re eps0 A0 <1/(u + h0)>``."""
        return self._sums.capacitance_f

    @property
    def conductance_s(self) -> Tensor:
        """Conductance of one finger's contact [S], parallel to the capacitance; 0 at 0 Hz."""
        return self._sums.conductance_s

    @property
    def current_a(self) -> Tensor | None:
        """Amplitude of the current through one finger [A]; None without a frequency."""
        return self._sums.current_a

    @cached_property
    def _sums(self) -> GapSums:
        return self.sum_gaps()


@dataclass(frozen=True)
class PeriodState(Table):
    """One period of the drive; every tensor has shape (samples,)."""

    t_s: Tensor
    """Time from the start of the period."""
    drive_v: Tensor
    """Voltage of the drive."""
    attraction_pa: Tensor
    """Attraction of gaps and contact spots."""
    pressure_pa: Tensor
    """Effective pressure p that the contact carries."""
    mu: Tensor
    """Friction coefficient."""
    status: Tensor
    """Integers of `Status`."""

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw friction against time into axes of matplotlib, or into new ones; return them."""
        ax = axes_or_new(ax)
        ax.plot(self.t_s.cpu(), self.mu.detach().cpu())
        ax.set(xlabel="time (s)", ylabel="friction coefficient")
        return ax


def check_device(device: torch.device | str) -> None:
    """Raise `InputError` unless torch computes on a device here."""
    try:
        torch.empty(0, device=device)
    except (AssertionError, RuntimeError) as error:  # the former of a torch without CUDA
        why = str(error).splitlines()[0][:200]
        raise InputError(
            f'device: expected one that torch has here, such as "cpu", got {str(device)!r}: {why}'
        ) from None


def plain_array(value: Any) -> Any:
    """Return an array, or a series of pandas, as torch takes it; anything else as it is.

    torch takes no negative strides, no other order of bytes, no array that cannot be written, and
    looks a series up by its labels.
    """
    if not isinstance(value, np.ndarray) and hasattr(value, "to_numpy"):
        value = value.to_numpy()
    if isinstance(value, np.ndarray):
        value = np.require(value, value.dtype.newbyteorder("="), ["C", "W"])
    return value


def checked(
    name: str, value: Any, expected: str, device: torch.device, zero: bool = False
) -> Tensor:
    """Return a float64 tensor of finite values above 0, or with `zero` of 0 and more.

    Raises `InputError` naming the quantity, what was `expected` and the first wrong value.
    """
    value = plain_array(value)
    try:
        tensor = torch.as_tensor(value, dtype=torch.float64, device=device)
    except (TypeError, ValueError, RuntimeError, OverflowError):
        raise InputError(f"{name}: expected numbers {expected}, got {value!r}") from None
    good = tensor.isfinite() & ((tensor >= 0) if zero else (tensor > 0))
    if tensor.numel() == 0 or not bool(good.all()):
        bad = tensor[~good].reshape(-1)
        got = f"{float(bad[0]):g}" if len(bad) else "an empty tensor"
        raise InputError(f"{name}: expected finite values {expected}, got {got}")
    return tensor


def broadcast_shape(*tensors: Tensor) -> torch.Size:
    """Return the shape to which the tensors broadcast, or raise `InputError`.

    Examples
    --------
    >>> broadcast_shape(torch.zeros(3, 1), torch.zeros(4))
    torch.Size([3, 4])
    """
    try:
        # torch's own function would import its compiler first, which takes half a second.
        return torch.Size(np.broadcast_shapes(*(tensor.shape for tensor in tensors)))
    except ValueError:
        raise InputError(
            "expected inputs that broadcast together, got shapes "
            f"{', '.join(str(tuple(tensor.shape)) for tensor in tensors)}"
        ) from None
