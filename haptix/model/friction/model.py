"""The contact model: from force and voltage to friction."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from math import pi, sqrt
from typing import Any

import numpy as np
import torch
from torch import Tensor

from haptix.base.checks import choice, eager, instance, whole
from haptix.base.display import Displayed
from haptix.base.errors import InputError, LimitError
from haptix.base.threads import backward_on_one_thread, one_thread
from haptix.model.contact import THEORIES, Accuracy, ContactSpots, GapDistribution, TheoryName
from haptix.model.contact.accuracy import of_states
from haptix.model.contact.persson import check_contact_spots
from haptix.model.electro import Pull, drive_voltage
from haptix.model.electro.attraction import Circuit, field_in_time
from haptix.model.electro.breakdown import breakdown_voltage, peak_field
from haptix.model.fidelity import (
    FIDELITIES,
    Ability,
    BoundaryElementBalance,
    BoundaryElementBox,
    BoxedFinger,
    Contact,
    FidelityName,
    MeanFieldBalance,
    Scatter,
)
from haptix.model.finger import Finger
from haptix.model.friction.solver import FrictionSolver
from haptix.model.screen import Screen
from haptix.model.states import (
    ContactState,
    PeriodState,
    broadcast_shape,
    check_device,
    checked,
)
from haptix.model.status import Status
from haptix.model.terms import TERMS, ActiveTerms, Properties, Stage, chosen_terms
from haptix.model.waves import Waveform

LOWEST_FORCE_N, HIGHEST_FORCE_N = 1e-9, 1e6
"""Range of forces: far beyond those of any finger, and far from the ends of double precision."""

REFERENCE_FORCE_N = 0.5
"""Force at which `in_theory` keeps friction without voltage: the middle of the paper's 0.1 to 0.9
N, and the force of its Fig. 4."""

_FAINT_V = 1e-9  # in place of 0 V, whose attraction has no logarithm to tabulate
_COSINE = Waveform(shift_turns=0.25)  # the drive of the paper
_BEYOND = 2.0  # times the screen's limit: a pull-in voltage above that is cut to it


class ContactModel(Displayed):
    """Friction of a finger on a screen under voltage.

    ``p = F_N/A0 + p_a``, ``p_a = eps0 V0^2 I(p, h0)/4``, ``mu = tau_f A(p)/F_N`` (Ayyildiz et al.,
    PNAS 2018, Eq. 1-3), followed on the lowest branch from V0 = 0.

    Parameters
    ----------
    finger : Finger
        The finger. Fields given as tensors that require grad are differentiated through.
    screen : Screen
        The touchscreen.
    fidelity : {"mean-field", "closed-form", "boundary-element"}
        How the contact is solved.
    dtype : torch.dtype
        Precision of the results. The arithmetic is float64: float32 is within 6e-8, relative.
    device : str
        Device of the tables.
    theory : {"local", "corrected", "open-gaps", "as-published"}, optional
        Form of the mean field (`haptix.model.THEORIES`). "local" agrees with boundary
        elements with and without voltage, "corrected" without voltage; "open-gaps" is the paper
        without the attraction inside the contact spots, "as-published" the paper as printed. By
        default the finger's. In another form the model's `finger` has the tau_f of `in_theory`.
    contact_spots : {"excluded", "included", "widened"}, optional
        Whether the attraction inside the contact spots loads the contact, or the attraction beside
        them widens them; by default the theory's.
    gap_distribution : {"plain", "combined", "mean-conserving"}, optional
        See `haptix.model.MeanField`; by default the theory's.
    gamma : float, optional
        Factor of the elastic energy in the separation; by default the theory's.
    terms : set of str, or mapping of str to bool, optional
        A set names all terms that are on; a mapping switches single terms on or off. By default the
        terms are on for which finger and screen have values. `haptix.model.terms.TERMS` lists all.
    boundary_elements : BoundaryElementBox, optional
        Surfaces of fidelity "boundary-element". The default box holds only a part of a finger's
        roughness, and warns of it. `contact` and `theory` are then the mean field of that part.
        Pull-in is searched up to the highest voltage that is requested at a place; it is infinite
        if the contact does not pull in below that.
    on_progress : callable, optional
        Called during a solve by boundary elements with the share that is done.

    Raises
    ------
    InputError
        If a name is unknown, or terms contradict each other, the profiles or the fidelity.

    Examples
    --------
    >>> import haptix
    >>> finger, screen = haptix.Finger.preset("dry"), haptix.Screen()
    >>> model = haptix.ContactModel(finger, screen, theory="corrected")
    >>> model.theory, model.fidelity
    ('corrected', 'mean-field')
    """

    def _shown(self) -> dict[str, Any]:
        parts = {"finger": self.finger.name, "screen": self.screen.name}
        return {**parts, "fidelity": self.fidelity, "theory": self.theory}

    def __init__(
        self,
        finger: Finger,
        screen: Screen,
        fidelity: FidelityName = "mean-field",
        dtype: torch.dtype = torch.float64,
        device: torch.device | str = "cpu",
        contact_spots: ContactSpots | None = None,
        gap_distribution: GapDistribution | None = None,
        gamma: float | None = None,
        terms: Iterable[str] | Mapping[str, bool] | None = None,
        theory: TheoryName | None = None,
        boundary_elements: BoundaryElementBox | None = None,
        on_progress: Callable[[float], None] | None = None,
    ) -> None:
        instance("finger", finger, Finger, 'haptix.Finger.preset("semi-wet") is one')
        instance("screen", screen, Screen, 'haptix.Screen.preset("3m-sct3250") is one')
        if fidelity not in FIDELITIES:
            names = ", ".join(f'"{name}"' for name in FIDELITIES)
            raise InputError(f"fidelity: expected one of {names}, got {fidelity!r}")
        finger = finger if theory is None else in_theory(finger, theory)
        self.theory: TheoryName = finger.theory
        chosen, how = THEORIES[self.theory], FIDELITIES[fidelity]
        self.contact_spots: ContactSpots = contact_spots or chosen.contact_spots
        check_contact_spots(self.contact_spots)
        self.boxed: BoxedFinger | None = None
        if Ability.SCATTER in how.can:
            self.boxed = BoxedFinger(finger, boundary_elements or BoundaryElementBox())
        elif boundary_elements is not None:
            raise InputError(
                f'boundary_elements: expected none with fidelity "{fidelity}", got a box; leave it '
                f"out, or use {_able(Ability.SCATTER)}"
            )
        check_device(device)
        self.terms = chosen_terms(terms, finger, screen, how, chosen.usual_terms)
        self.finger = finger
        self.screen = screen
        self.fidelity = fidelity
        self.dtype = dtype
        active = ActiveTerms(Properties(finger, screen), self.terms)
        self.contact = chosen.mean_field(
            (finger.roughness if self.boxed is None else self.boxed.roughness).spectrum(),
            active.solid(),
            gamma=gamma,
            gap_distribution=gap_distribution,
            device=device,
        )
        usual = torch.tensor(REFERENCE_FORCE_N, dtype=torch.float64)
        contact = Contact(
            self.contact,
            self.contact_spots,
            active.hardness_pa(),
            float(usual / active.apparent_area_m2(usual)),
            self.boxed,
            on_progress,
        )
        self.solver = FrictionSolver(active, how(contact))

    def require(self, ability: Ability, who: str) -> None:
        """Raise `InputError` unless the fidelity has an ability that `who` needs.

        Parameters
        ----------
        ability : Ability
            Quantities that are needed.
        who : str
            Name of the caller, with which the message begins.
        """
        if ability not in FIDELITIES[self.fidelity].can:
            raise InputError(
                f"{who}: expected a fidelity that {ability} ({_able(ability)}), got "
                f'"{self.fidelity}"'
            )

    def reports(self, status: Status) -> bool:
        """Whether a term that is on reports this status."""
        return any(term.reports == status for term in self.solver.terms.all)

    def describe(self) -> dict[str, Any]:
        """Everything that determines the model's numbers, as plain values for files and hashes.

        Examples
        --------
        >>> import haptix
        >>> model = haptix.ContactModel(haptix.Finger(), haptix.Screen(), fidelity="closed-form")
        >>> model.describe()["fidelity"]
        'closed-form'
        """
        # The response smooths friction in time only, and the theory has its entry below.
        finger = self.finger.model_dump(mode="json", exclude={"response_hz_per_mm_per_s", "theory"})
        screen = self.screen.model_dump(mode="json")
        values = {"finger": finger, "screen": screen}
        terms = {}
        for name, term in TERMS.items():
            places = [(field, *field.split(".")) for field in term.uses]
            terms[name] = {
                "on": name in self.terms,
                "what": term.summary,
                "source": term.source,
                "parameters": {
                    field: values[owner].get(key, getattr(getattr(self, owner), key))
                    for field, owner, key in places
                },
            }
        boxed = {} if self.boxed is None else {"boundary_elements": self.boxed.describe()}
        return {
            "fidelity": self.fidelity,
            **boxed,
            "theory": self.theory,
            "area_slowing": self.contact.area.slowing,
            "contact_spots": self.contact_spots,
            "gap_distribution": self.contact.gap_distribution,
            "gamma": self.contact.gamma,
            "roughness": self.contact.spectrum.statement(),
            "dtype": str(self.dtype).removeprefix("torch."),
            "terms": terms,
            "placeholders": self.placeholders(),
            "finger": finger,
            "screen": screen,
        }

    def placeholders(self) -> list[str]:
        """Names of the unmeasured values that the model's numbers rest on.

        Examples
        --------
        >>> import haptix
        >>> haptix.ContactModel(haptix.Finger.preset("wet"), haptix.Screen()).placeholders()
        ['roughness spectrum of the finger', 'dielectric of the skin']
        """
        names = self.finger.roughness.unmeasured(self.finger.apparent_area_at_1n_m2)
        return names + self.solver.terms.placeholders() + self.screen.warnings()

    @eager
    @one_thread()
    def solve(
        self, normal_force_n: Any, voltage_v: Any, frequency_hz: Any = None, h0_m: Any = None
    ) -> ContactState:
        """Solve for floats or tensors that broadcast together.

        Parameters
        ----------
        normal_force_n : float or Tensor
            Normal force F_N [N], above 0.
        voltage_v : float or Tensor
            Amplitude V0 [V], 0 to the screen's limit.
        frequency_hz : float, Tensor or None
            Drive frequency [Hz]; None leaves the skin's dielectric out.
        h0_m : float, Tensor or None
            Effective thickness of the screen's insulator [m]; None takes the screen's own.

        Raises
        ------
        InputError
            If a value is not finite or outside its range.
        LimitError
            If a voltage is above the screen's limit.

        Examples
        --------
        >>> import haptix
        >>> finger, screen = haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
        >>> model = haptix.ContactModel(finger, screen)
        >>> state = model.solve(normal_force_n=0.5, voltage_v=[0.0, 100.0])
        >>> bool(state.mu[1] > state.mu[0])  # the voltage attracts the skin
        True
        >>> haptix.Status(int(state.status[1])).name
        'OK'
        """
        voltage = self._voltage(voltage_v)
        return self._solve(voltage, *self._places(normal_force_n, frequency_hz, h0_m))

    @eager
    @one_thread()
    def at_drive(
        self, normal_force_n: Any, drive: Any, frequency_hz: Any = None, h0_m: Any = None
    ) -> ContactState:
        """Solve at shares of each contact's pull-in: ``drive = (V0 / V_pull-in)^2``.

        Surfaces are tabulated in these shares. The screen's voltage limit is not checked, because
        it may lie between two nodes of a surface. Other parameters, the result and the errors are
        those of `solve`.

        Parameters
        ----------
        normal_force_n, frequency_hz, h0_m : float or Tensor
            As in `solve`.
        drive : float or Tensor
            0 or more.
        """
        self.require(Ability.TABULATE, "at_drive")
        share = self._checked("drive", drive, "of 0 or more", zero=True)
        places = self._places(normal_force_n, frequency_hz, h0_m)
        if Stage.PULL not in self.solver.terms.stages:
            return self._solve(share, *places, of_end=True)
        pull_in = self._solve(share.new_zeros(()), *places).pull_in_voltage_v
        # Light contact may have no end; a voltage that no drive reaches takes its place.
        unit = pull_in.to(torch.float64).clamp(max=_BEYOND * self.screen.max_voltage_v)
        state = self._solve(unit * share.sqrt(), *places)
        return replace(state, pull_in_voltage_v=unit.to(self.dtype).expand(state.mu.shape))

    def _places(
        self, normal_force_n: Any, frequency_hz: Any, h0_m: Any
    ) -> tuple[Tensor, Tensor | None, Tensor]:
        """Check a state's inputs, except the voltage."""
        force = self._checked("normal_force_n", normal_force_n, "above 0 N")
        if not bool(((force >= LOWEST_FORCE_N) & (force <= HIGHEST_FORCE_N)).all()):
            raise InputError(
                f"normal_force_n: expected {LOWEST_FORCE_N:g} to {HIGHEST_FORCE_N:g} N, got "
                f"{float(force.detach().min()):g} to {float(force.detach().max()):g} N"
            )
        h0 = self._checked("h0_m", self.screen.h0_m if h0_m is None else h0_m, "above 0 m")
        if frequency_hz is not None:
            frequency_hz = self._checked("frequency_hz", frequency_hz, "above 0 Hz")
        return force, frequency_hz, h0

    def _solve(
        self,
        voltage: Tensor,
        force: Tensor,
        frequency_hz: Tensor | None,
        h0: Tensor,
        of_end: bool = False,
    ) -> ContactState:
        """Solve at voltages, or with `of_end` at squared shares of those that end light contact."""
        force, voltage, circuit, shape = self._flat(voltage, force, frequency_hz, h0)

        def pull(at: slice | Tensor) -> Pull:
            of_voltage = self._pull(voltage[at], circuit.part(at))
            return replace(of_voltage, strength=voltage[at]) if of_end else of_voltage

        mu, balance = self.solver.solve_in_blocks(force, pull, circuit.column, of_end)
        if of_end:
            voltage = drive_voltage(balance.strength_at_end) * voltage.sqrt()
        at_contact = voltage * balance.voltage_share
        # By column, since states far outnumber these.
        thickness = circuit.thickness_m.abs()[circuit.column]
        breakdown = breakdown_voltage(
            circuit.thickness_m,
            self.screen.insulator_permittivity,
            self.screen.insulator_strength_v_per_m,
        )[circuit.column]
        area = self.solver.terms.apparent_area_m2(force)
        solved = {
            "mu": mu,
            "x": force / area / (sqrt(2) * self.contact.stress_rms_pa),
            "rolloff_waves": area * (self.contact.spectrum.q_rolloff / (2 * pi)) ** 2,
            "area_fraction": balance.area_fraction,
            "pressure_pa": balance.pressure_pa,
            "gap_attraction_pa": balance.gap_attraction_pa,
            "spot_attraction_pa": balance.spot_attraction_pa,
            "mean_gap_m": balance.mean_gap_m,
            "pull_in_voltage_v": drive_voltage(balance.strength_at_end),
            "peak_field_v_per_m": peak_field(at_contact, thickness),
            "breakdown_voltage_v": breakdown / balance.voltage_share,
            "spot_pressure_pa": self.solver.spot_pressure_pa(mu, balance),
        }

        def field(gap_m: float) -> Tensor:
            return at_contact / (gap_m + circuit.thickness_m).abs()[circuit.column]

        status = self.solver.status(mu, balance, field)

        def find_status() -> Tensor:
            if not self.reports(Status.BREAKDOWN):
                light = (status == int(Status.OK)) & (at_contact > breakdown)
                past = self.solver.past_breakdown(
                    light.nonzero()[:, 0], force, at_contact, circuit, self._pull, balance
                )
                status[past] = int(Status.BREAKDOWN)
            return status.reshape(shape)

        contact, applied = self.solver.fidelity.contact, force / area

        def find_yielded_area() -> Tensor:
            return contact.yielded_area(applied).detach().reshape(shape)

        def find_accuracy() -> Accuracy:
            states = (
                solved["x"],
                thickness / self.contact.spectrum.h_rms_m,
                balance.gap_attraction_pa / applied,
                balance.area_fraction / contact.area_fraction(applied),
                find_yielded_area(),
            )
            theory = self.theory if self.fidelity == MeanFieldBalance.name else None
            return of_states(theory, *(part.detach().reshape(shape) for part in states))

        solved = {
            name: backward_on_one_thread(value.to(self.dtype).reshape(shape))
            for name, value in solved.items()
        }
        return ContactState(
            **solved,
            find_status=find_status,
            find_accuracy=find_accuracy,
            find_yielded_area=find_yielded_area,
            of_finger=tuple(self.finger.roughness.warnings),
            sum_gaps=partial(
                self.solver.sum_gaps,
                force,
                at_contact,
                None if frequency_hz is None else frequency_hz.expand(shape).reshape(-1),
                circuit,
                self._pull,
                balance,
                solved["mu"],
            ),
        )

    def _flat(
        self, voltage: Tensor, force: Tensor, frequency_hz: Tensor | None, h0: Tensor
    ) -> tuple[Tensor, Tensor, Circuit, torch.Size]:
        """Force, voltage and circuit of every state, and the states' shape."""
        inputs = [force, voltage, h0] + ([] if frequency_hz is None else [frequency_hz])
        shape = broadcast_shape(*inputs)
        thickness = self.solver.terms.thickness(h0, frequency_hz)
        column = torch.arange(thickness.numel(), device=thickness.device).reshape(thickness.shape)
        force, voltage, column = (t.expand(shape).reshape(-1) for t in (force, voltage, column))
        medium = torch.ones_like(thickness)
        if frequency_hz is not None:
            medium = medium * self.solver.terms.gap_permittivity(frequency_hz)
        circuit = Circuit(thickness.reshape(-1), medium.reshape(-1), column).shared()
        return force, voltage, circuit, shape

    def _pull(self, voltage: Tensor, circuit: Circuit) -> Pull:
        edges = self.contact.gap_edges_m
        limit = self.solver.terms.field_limit()
        pull = Pull.of_sine(edges, voltage, circuit.thickness_m, circuit.column, limit)
        return replace(pull, circuit=circuit)

    @one_thread()
    def scatter(
        self, normal_force_n: Any, voltage_v: Any, frequency_hz: Any = None, h0_m: Any = None
    ) -> Scatter:
        """Return the equilibrium on each surface of the boundary elements; free after a `solve`.

        Inputs and errors are those of `solve`; another fidelity raises `InputError` too. Tensors
        have the broadcast shape of the inputs, with the surfaces as the last axis.

        Parameters
        ----------
        normal_force_n, voltage_v, frequency_hz, h0_m : float or Tensor
            As in `solve`.
        """
        self.require(Ability.SCATTER, "scatter")
        fidelity = self.solver.fidelity
        assert isinstance(fidelity, BoundaryElementBalance)
        voltage = self._voltage(voltage_v)
        places = self._places(normal_force_n, frequency_hz, h0_m)
        force, voltage, circuit, shape = self._flat(voltage, *places)
        scattered = fidelity.scatter(self.solver.load(force, self._pull(voltage, circuit)))
        return Scatter(*(column.reshape(*shape, -1) for column in vars(scattered).values()))

    @eager
    @one_thread()
    def over_period(
        self,
        normal_force_n: float,
        voltage_v: float,
        frequency_hz: float,
        waveform: Waveform | None = None,
        h0_m: float | None = None,
        samples: int = 256,
    ) -> PeriodState:
        """Solve one drive period in time; the contact follows the attraction without delay.

        Parameters
        ----------
        normal_force_n, voltage_v, frequency_hz : float
            Force [N], amplitude [V] and frequency of the drive [Hz].
        waveform : Waveform, optional
            Shape of the drive; by default ``cos(2 pi f t)``.
        h0_m : float, optional
            Effective thickness of the screen's insulator [m]; by default the screen's own.
        samples : int
            Instants in the period, 8 or more.

        Raises
        ------
        InputError, LimitError
            As `solve` does.

        Examples
        --------
        >>> import haptix
        >>> model = haptix.ContactModel(haptix.Finger.preset("semi-wet"), haptix.Screen())
        >>> period = model.over_period(0.5, 100.0, frequency_hz=125.0, samples=32)
        >>> len(period.mu), float(period.t_s[16]) * 125.0  # half a period
        (32, 0.5)
        """
        waveform = _COSINE if waveform is None else waveform
        self.require(Ability.INSTANTS, "over_period")
        samples = whole("samples", samples, least=8)
        force = self._checked("normal_force_n", normal_force_n, "above 0 N")
        voltage = self._voltage(voltage_v)
        frequency = self._checked("frequency_hz", frequency_hz, "above 0 Hz")
        h0 = self._checked("h0_m", self.screen.h0_m if h0_m is None else h0_m, "above 0 m")
        if many := [tuple(one.shape) for one in (force, voltage, frequency, h0) if one.ndim]:
            raise InputError(f"over_period: expected one state, got arrays of shape {many[0]}")
        force = force.expand(samples)
        turns = np.arange(samples) / samples
        phase = 2 * torch.pi * torch.from_numpy(turns).to(self.contact.device)

        def field(gap_m: Tensor) -> Tensor:
            return field_in_time(
                waveform,
                gap_m,
                max(float(voltage), _FAINT_V),
                float(frequency),
                lambda harmonic: self.solver.terms.thickness(h0, harmonic),
                phase,
            )

        # The circuit divides the voltage at all instants as at the drive's fundamental frequency.
        thickness = self.solver.terms.thickness(h0, frequency)
        medium = thickness.new_ones(()) * self.solver.terms.gap_permittivity(frequency)
        pull = replace(
            Pull.of_field(self.contact.gap_edges_m, field, self.solver.terms.field_limit()),
            circuit=Circuit.of_one(thickness, medium, samples),
        )
        mu, balance = self.solver.solve(force, pull)
        status = self.solver.status(
            mu,
            balance,
            lambda gap_m: field(h0.new_tensor([gap_m])).abs()[:, 0] * balance.voltage_share,
        )
        return PeriodState(
            t_s=(phase / (2 * torch.pi * frequency)).to(self.dtype),
            drive_v=(voltage * torch.from_numpy(waveform.at(turns)).to(phase.device)).to(
                self.dtype
            ),
            attraction_pa=(balance.gap_attraction_pa + balance.spot_attraction_pa).to(self.dtype),
            pressure_pa=balance.pressure_pa.to(self.dtype),
            mu=mu.to(self.dtype),
            status=status,
        )

    def _checked(self, name: str, value: Any, expected: str, zero: bool = False) -> Tensor:
        return checked(name, value, expected, self.contact.device, zero)

    def _voltage(self, voltage_v: Any) -> Tensor:
        """Check amplitudes, the screen's limit included."""
        voltage = self._checked("voltage_v", voltage_v, "of 0 V or more", zero=True)
        highest = float(voltage.detach().max())
        if highest > self.screen.max_voltage_v:
            raise LimitError(
                f"voltage_v: {highest:g} V is above the limit of {self.screen.max_voltage_v:g} V "
                f"of screen {self.screen.name!r}; lower it (it is rejected, not clamped)"
            )
        return voltage


def _able(ability: Ability) -> str:
    """Names of the fidelities that have an ability."""
    return " or ".join(f'"{name}"' for name, how in FIDELITIES.items() if ability in how.can)


def in_theory(finger: Finger, theory: TheoryName) -> Finger:
    """Return the finger with the tau_f that belongs to another form of the mean field.

    tau_f is fitted to measured friction. mu is tau_f times the area over the force, and each form
    gives another area, so that the same friction needs another tau_f. Friction at 0.5 N without
    voltage does not change. Raises `InputError` if there is no such form.

    Parameters
    ----------
    finger : Finger
        A finger with the tau_f of its `theory`.
    theory : {"local", "corrected", "open-gaps", "as-published"}
        The form to convert it to.

    Examples
    --------
    >>> import haptix
    >>> in_theory(haptix.Finger.preset("wet"), "corrected").theory
    'corrected'
    """
    choice("theory", theory, THEORIES)
    if theory == finger.theory:
        return finger
    ratio = _area_at_rest(finger, finger.theory) / _area_at_rest(finger, theory)
    stress = finger.frictional_shear_stress_pa * ratio
    new_stress = stress if stress.requires_grad else float(stress)
    return finger.replace(theory=theory, frictional_shear_stress_pa=new_stress)


def _area_at_rest(finger: Finger, theory: TheoryName) -> Tensor:
    """A/A0 at the reference force without voltage; it does not depend on the screen."""
    screen, form = Screen(), THEORIES[theory]
    terms = chosen_terms(None, finger, screen, MeanFieldBalance)
    active = ActiveTerms(Properties(finger, screen), terms)
    field = form.mean_field(finger.roughness.spectrum(), active.solid())
    force = torch.tensor(REFERENCE_FORCE_N, dtype=torch.float64)
    applied = force / active.apparent_area_m2(force)
    contact = Contact(field, form.contact_spots, active.hardness_pa(), float(applied))
    return contact.area_fraction(applied)
