"""The contact model: from force and voltage to friction."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from typing import Any, Literal, get_args

import numpy as np
import torch
from torch import Tensor

from haptix.contact import ContactSpots, GapDistribution, MeanField, named_theory
from haptix.contact.finite_size import highest_asperity
from haptix.contact.gaps import bin_inverse_square
from haptix.contact.meanfield import check_contact_spots
from haptix.contact.plasticity import elastoplastic_area
from haptix.electro import drive_strength, drive_voltage, effective_thickness
from haptix.electro.breakdown import (
    PASCHEN_MINIMUM_GAP_M,
    PASCHEN_MINIMUM_V,
    bearable_field,
    breakdown_voltage,
    peak_field,
)
from haptix.electro.waveform import fields as fields_in_time
from haptix.electro.waveform import pulls
from haptix.errors import InputError, LimitError
from haptix.fidelity import (
    BoundaryElementBalance,
    BoundaryElementBox,
    BoxedFinger,
    ClosedForm,
    Fidelity,
    Load,
    MeanFieldBalance,
    Scatter,
)
from haptix.finger import Finger
from haptix.inputs import broadcast_shape, checked
from haptix.screen import Screen
from haptix.states import ContactState, PeriodState
from haptix.status import Status
from haptix.terms import TERMS, chosen_terms
from haptix.threads import one_thread
from haptix.waves import Waveform

FidelityName = Literal["closed-form", "mean-field", "boundary-element"]

LOWEST_FORCE_N, HIGHEST_FORCE_N = 1e-9, 1e6
"""Forces that are solved: far beyond any finger, and far from the ends of double precision."""

_FAINT_V = 1e-9  # pulls are tabulated by their logarithm: no voltage is one that pulls nothing
_COSINE = Waveform(shift_turns=0.25)  # the drive of the paper
_SHORTED_M = 1e6  # thickness that leaves a gap no field: what leaks shorts a steady voltage

_BLOCK = 4096  # states solved together: bounds the memory, and fits the cache
_REFERENCE_FORCE_N = 0.5  # where the closed form is exact; the middle of the paper's range


class ContactModel:
    """Friction of a finger on a screen under voltage.

    ``p = F_N/A0 + p_a``, ``p_a = eps0 V0^2 I(p, h0)/4``, ``mu = tau_f A(p)/F_N`` (Ayyildiz et al.,
    PNAS 2018, Eq. 1-3), followed on the lowest branch from V0 = 0.

    Parameters
    ----------
    finger : Finger
        What touches. Fields given as tensors that require grad are differentiated through.
    screen : Screen
        What is touched.
    fidelity : {"mean-field", "closed-form", "boundary-element"}
        How the contact is solved.
    dtype : torch.dtype
        Of the results. The arithmetic is float64, so float32 results are within 6e-8, relative.
    device : str
        Where the tables live.
    theory : {"open-gaps", "as-published", "corrected"}
        Form of the mean field: the paper's, but for the pull inside the contact spots; the paper
        as printed; or what agrees with boundary elements, see `haptix.contact.THEORIES`.
    contact_spots : {"excluded", "included"}, optional
        Whether the pull inside the contact spots loads the contact; as the theory has it without.
    gap_distribution : {"plain", "combined"}, optional
        See `haptix.contact.MeanField`; as the theory has it without.
    gamma : float, optional
        Factor of the elastic energy in the separation; as the theory has it without.
    terms : set of str, or mapping of str to bool, optional
        Names of all terms that are on, or single ones to switch; without it those that finger and
        screen call for. `haptix.terms.TERMS` has them all.
    boundary_elements : BoundaryElementBox, optional
        Surfaces of fidelity "boundary-element". The default holds but a part of a finger's
        roughness, and warns of it; `contact` and `theory` are then the mean field of that part.
        Pull-in is looked for up to the highest voltage asked for at a place; where it is not met
        its voltage is infinite.
    on_progress : callable, optional
        Called during a solve by boundary elements with the share that is done.

    Raises
    ------
    InputError
        If a name is unknown, or terms contradict each other, the profiles or the fidelity.
    """

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
        theory: str = "open-gaps",
        boundary_elements: BoundaryElementBox | None = None,
        on_progress: Callable[[float], None] | None = None,
    ) -> None:
        if fidelity not in get_args(FidelityName):
            raise InputError(
                'fidelity: expected "mean-field", "closed-form" or "boundary-element", got '
                f"{fidelity!r}"
            )
        chosen = named_theory(theory)
        self.theory = theory
        self.contact_spots: ContactSpots = contact_spots or chosen.contact_spots
        check_contact_spots(self.contact_spots)
        self.boxed = self._boxed(finger, fidelity, boundary_elements)
        self.on_progress = on_progress
        self.terms = chosen_terms(terms, finger, screen, fidelity)
        self.finger = finger
        self.screen = screen
        self.fidelity = fidelity
        self.dtype = dtype
        self.contact = MeanField(
            (finger.roughness if self.boxed is None else self.boxed.roughness).spectrum(),
            finger.solid(layered="layered-skin" in self.terms),
            gamma=chosen.gamma if gamma is None else gamma,
            gap_distribution=gap_distribution or chosen.gap_distribution,
            device=device,
            area=chosen.area,
        )
        self.solver = self._solver()

    def _boxed(
        self, finger: Finger, fidelity: FidelityName, box: BoundaryElementBox | None
    ) -> BoxedFinger | None:
        if fidelity != "boundary-element":
            if box is None:
                return None
            raise InputError(
                f'boundary_elements: expected none with fidelity "{fidelity}", got a box; leave it '
                'out, or use "boundary-element"'
            )
        if self.contact_spots == "included":
            raise InputError(
                'contact_spots: expected "excluded" with fidelity "boundary-element", got '
                '"included": the pull acts on every point, and inside a spot the contact itself '
                "bears it"
            )
        given = [value for part in (finger, finger.roughness) for _, value in part]
        if any(isinstance(value, Tensor) and value.requires_grad for value in given):
            raise InputError(
                "finger: expected values that need no gradient: boundary elements have none, got a "
                'tensor that requires grad; detach it, or use fidelity "mean-field"'
            )
        return BoxedFinger(finger, box or BoundaryElementBox())

    def _solver(self) -> Fidelity:
        if self.fidelity == "closed-form":
            force = torch.tensor(_REFERENCE_FORCE_N, dtype=torch.float64)
            reference = float(force / self._apparent_area(force))
            return ClosedForm(self.contact, reference, self.contact_spots)
        if self.boxed is not None:
            hardness = self.finger.hardness_pa if "plasticity" in self.terms else None
            return BoundaryElementBalance(
                self.boxed,
                self.finger.solid(layered="layered-skin" in self.terms),
                None if hardness is None else float(hardness),
                self.contact.device,
                self.on_progress,
            )
        return MeanFieldBalance(
            self.contact,
            self.area_fraction,
            self._highest_asperity if "finite-size" in self.terms else None,
            self.contact_spots,
            keeps_table=not self.contact.stress_variance.requires_grad,
        )

    def area_fraction(self, pressure_pa: Tensor) -> Tensor:
        """A/A0 at pressures [Pa]: elastic, or elastoplastic where that term is on."""
        if "plasticity" not in self.terms:
            return self.contact.area_fraction(pressure_pa)
        hardness = self.finger.hardness_pa
        assert hardness is not None  # the term needs it
        spread = pressure_pa / self.contact.area.argument(pressure_pa / self.contact.stress_rms_pa)
        return elastoplastic_area(pressure_pa, spread, hardness).total

    def _apparent_area(self, normal_force_n: Tensor) -> Tensor:
        if "apparent-area" in self.terms:
            return self.finger.apparent_area_m2(normal_force_n)
        return self.finger.apparent_area_m2(torch.ones_like(normal_force_n))

    def _highest_asperity(self, apparent_area_m2: Tensor) -> Tensor:
        spectrum = self.contact.spectrum
        return highest_asperity(spectrum.h_rms_m, spectrum.q_rolloff, apparent_area_m2)

    def effective_thickness(self, h0_m: Tensor, frequency_hz: Tensor | None) -> Tensor:
        """h0 of screen, skin and leaking gap [m], real without a frequency, else complex."""
        skin = self.finger.dielectric if "skin-dielectric" in self.terms else None
        leak = self.screen.gap_resistivity_ohm_m if "leaky-gap" in self.terms else None
        if leak is not None and frequency_hz is None:
            raise InputError(
                'frequency_hz: expected one, since the term "leaky-gap" depends on it; give one or '
                "switch the term off"
            )
        return effective_thickness(h0_m, frequency_hz, self.finger.layer_thickness_m, skin, leak)

    def describe(self) -> dict[str, Any]:
        """Everything that determines the model's numbers, as plain values for files and hashes."""
        # The response smooths friction in time: it changes none of the model's numbers.
        finger = self.finger.model_dump(mode="json", exclude={"response_hz_per_mm_per_s"})
        screen = self.screen.model_dump(mode="json")
        terms = {}
        for name, term in TERMS.items():
            used = {f"finger.{field}": finger[field] for field in term.finger_fields}
            used |= {f"screen.{field}": screen[field] for field in term.screen_fields}
            terms[name] = {
                "on": name in self.terms,
                "what": term.summary,
                "source": term.source,
                "parameters": used,
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
        """Name the stand-ins for measured data that the model's numbers rest on."""
        found = []
        if self.finger.roughness.is_placeholder:
            found.append("roughness spectrum of the finger")
        if "skin-dielectric" in self.terms and self.finger.dielectric.is_placeholder:
            found.append("dielectric of the skin")
        return found + self.screen.doubts()

    @one_thread()
    def solve(
        self,
        normal_force_n: Any,
        voltage_v: Any,
        frequency_hz: Any = None,
        h0_m: Any = None,
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
        """
        voltage = self._checked("voltage_v", voltage_v, "of 0 V or more", zero=True)
        self._check_limit(voltage)
        return self._solve(voltage, *self._places(normal_force_n, frequency_hz, h0_m))

    @one_thread()
    def at_drive(
        self, normal_force_n: Any, drive: Any, frequency_hz: Any = None, h0_m: Any = None
    ) -> ContactState:
        """Solve at shares of each contact's own pull-in: ``drive = (V0 / V_pull-in)^2``.

        What a surface tabulates: its nodes reach beyond the screen's limit where that lies between
        them, so it is not applied here. The rest is that of `solve`.

        Parameters
        ----------
        drive : float or Tensor
            0 or more.
        """
        if self.boxed is not None:
            raise InputError(
                'at_drive: expected a fidelity that knows every pull-in, got "boundary-element"; '
                "solve at voltages instead"
            )
        share = self._checked("drive", drive, "of 0 or more", zero=True)
        places = self._places(normal_force_n, frequency_hz, h0_m)
        pull_in = self._solve(share.new_zeros(()), *places).pull_in_voltage_v
        return self._solve(pull_in.to(torch.float64) * share.sqrt(), *places)

    def bends(self) -> dict[str, tuple[float, ...]]:
        """Values of an input at which the model has a corner: where a surface needs a node."""
        if "skin-dielectric" not in self.terms:
            return {}
        return {"frequency_hz": self.finger.dielectric.frequency_hz}

    def _places(
        self, normal_force_n: Any, frequency_hz: Any, h0_m: Any
    ) -> tuple[Tensor, Tensor | None, Tensor]:
        """Check all of a state but its voltage."""
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
        self, voltage: Tensor, force: Tensor, frequency_hz: Tensor | None, h0: Tensor
    ) -> ContactState:
        given = [force, voltage, h0] + ([] if frequency_hz is None else [frequency_hz])
        shape = broadcast_shape(*given)
        thickness = self.effective_thickness(h0, frequency_hz)
        # Blocks come in the order of the forces: a table that grew with each would be solved often.
        area = self._apparent_area(force)
        self.solver.prepare(force / area, area)
        column = torch.arange(thickness.numel(), device=thickness.device).reshape(thickness.shape)
        flat = [t.expand(shape).reshape(-1) for t in (force, voltage, column)]
        blocks = [
            self._solve_block(force, voltage, column, thickness.reshape(-1))
            for force, voltage, column in zip(*(t.split(_BLOCK) for t in flat), strict=True)
        ]
        return ContactState(
            *(
                torch.cat([getattr(block, field.name) for block in blocks]).reshape(shape)
                for field in fields(ContactState)
            )
        )

    def _solve_block(
        self, force: Tensor, voltage: Tensor, column: Tensor, thickness: Tensor
    ) -> ContactState:
        # Only the insulators that this block meets: with many, a table of all would not fit.
        used, column = column.unique(return_inverse=True)
        thickness = thickness[used]
        load = self._load(force, voltage, column, thickness)
        area = load.apparent_area_m2
        found = self.solver.solve(load)
        friction = self.finger.frictional_shear_stress_pa * found.area_fraction * area
        own_thickness = thickness[column]
        breakdown = breakdown_voltage(own_thickness, *self._insulator)
        return ContactState(
            mu=(friction / force).to(self.dtype),
            area_fraction=found.area_fraction.to(self.dtype),
            pressure_pa=found.pressure_pa.to(self.dtype),
            gap_attraction_pa=found.gap_attraction_pa.to(self.dtype),
            spot_attraction_pa=found.spot_attraction_pa.to(self.dtype),
            mean_gap_m=found.mean_gap_m.to(self.dtype),
            pull_in_voltage_v=drive_voltage(found.strength_at_end).to(self.dtype),
            peak_field_v_per_m=peak_field(voltage, own_thickness).to(self.dtype),
            breakdown_voltage_v=breakdown.to(self.dtype),
            status=self._status(found.is_stable, voltage > breakdown),
        )

    def _load(self, force: Tensor, voltage: Tensor, column: Tensor, thickness: Tensor) -> Load:
        area = self._apparent_area(force)
        return Load(
            applied_pa=force / area,
            apparent_area_m2=area,
            strength=drive_strength(voltage),
            gap_pull=bin_inverse_square(self.contact.gap_edges_m, thickness),
            spot_pull=thickness.abs() ** -2,
            column=column,
            thickness_m=thickness,
        )

    @one_thread()
    def scatter(
        self,
        normal_force_n: Any,
        voltage_v: Any,
        frequency_hz: Any = None,
        h0_m: Any = None,
    ) -> Scatter:
        """Return what each surface of the boundary elements gives, for inputs as `solve` has them.

        After a `solve` of the same states it costs nothing.

        Returns
        -------
        Scatter
            Tensors of the broadcast shape of the inputs, and (surfaces,).

        Raises
        ------
        InputError, LimitError
            As `solve` does; or if the fidelity is another one.
        """
        if not isinstance(self.solver, BoundaryElementBalance):
            raise InputError(
                f'scatter: expected fidelity "boundary-element", got "{self.fidelity}", which has '
                "no surfaces that could scatter"
            )
        voltage = self._checked("voltage_v", voltage_v, "of 0 V or more", zero=True)
        self._check_limit(voltage)
        force, frequency, h0 = self._places(normal_force_n, frequency_hz, h0_m)
        shape = broadcast_shape(*(t for t in (force, voltage, h0, frequency) if t is not None))
        thickness = self.effective_thickness(h0, frequency)
        column = torch.arange(thickness.numel(), device=thickness.device).reshape(thickness.shape)
        force, voltage, column = (t.expand(shape).reshape(-1) for t in (force, voltage, column))
        load = self._load(force, voltage, column, thickness.reshape(-1))
        found = self.solver.scatter(load)
        return Scatter(*(getattr(found, one.name).reshape(*shape, -1) for one in fields(Scatter)))

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
        """Solve one drive period in time, the contact following the pull without delay.

        Parameters
        ----------
        normal_force_n, voltage_v, frequency_hz : float
            Force [N], amplitude [V] and frequency of the drive [Hz].
        waveform : Waveform, optional
            Shape of the drive; ``cos(2 pi f t)`` without.
        h0_m : float, optional
            Effective thickness of the screen's insulator [m]; the screen's own without.
        samples : int
            Instants in the period, 8 or more.

        Raises
        ------
        InputError, LimitError
            As `solve` does.
        """
        waveform = _COSINE if waveform is None else waveform
        if samples < 8:
            raise InputError(f"samples: expected 8 or more in a period, got {samples}")
        force = self._checked("normal_force_n", normal_force_n, "above 0 N").expand(samples)
        voltage = self._checked("voltage_v", voltage_v, "of 0 V or more", zero=True)
        frequency = self._checked("frequency_hz", frequency_hz, "above 0 Hz")
        h0 = self._checked("h0_m", self.screen.h0_m if h0_m is None else h0_m, "above 0 m")
        self._check_limit(voltage)
        column = torch.arange(samples, device=self.contact.device)
        turns = np.arange(samples) / samples
        phase = 2 * torch.pi * torch.from_numpy(turns).to(self.contact.device)
        drive = (
            max(float(voltage), _FAINT_V),
            float(frequency),
            lambda harmonic: self._harmonic_thickness(h0, harmonic),
            phase,
        )
        gap_pull, spot_pull = pulls(waveform, self.contact.gap_edges_m, *drive)
        # At the edge of a spot, and in the gap where air gives way first.
        weakest = self.contact.gap_edges_m.new_tensor([0.0, PASCHEN_MINIMUM_GAP_M])
        at_spot, in_gap = fields_in_time(waveform, weakest, *drive).abs().unbind(-1)
        broken = (at_spot > bearable_field(*self._insulator)) | (
            in_gap * PASCHEN_MINIMUM_GAP_M > PASCHEN_MINIMUM_V
        )
        area = self._apparent_area(force)
        load = Load(force / area, area, torch.ones_like(phase), gap_pull, spot_pull, column)
        found = self.solver.solve(load)
        friction = self.finger.frictional_shear_stress_pa * found.area_fraction * area / force
        return PeriodState(
            t_s=(phase / (2 * torch.pi * frequency)).to(self.dtype),
            drive_v=(voltage * torch.from_numpy(waveform.at(turns))).to(self.dtype),
            attraction_pa=(found.gap_attraction_pa + found.spot_attraction_pa).to(self.dtype),
            pressure_pa=found.pressure_pa.to(self.dtype),
            mu=friction.to(self.dtype),
            status=self._status(found.is_stable, broken),
        )

    @property
    def _insulator(self) -> tuple[float, float]:
        return self.screen.insulator_permittivity, self.screen.insulator_strength_v_per_m

    def _status(self, is_stable: Tensor, breaks_down: Tensor) -> Tensor:
        status = torch.where(is_stable, int(Status.OK), int(Status.PULL_IN))
        if "breakdown" not in self.terms:
            return status
        return torch.where(is_stable & breaks_down, int(Status.BREAKDOWN), status)

    def _harmonic_thickness(self, h0: Tensor, frequency_hz: Tensor) -> Tensor:
        """h0 at harmonics of a drive; to a steady voltage skin and leaky gap are conductors."""
        steady = frequency_hz == 0
        thickness = self.effective_thickness(h0, torch.where(steady, 1.0, frequency_hz))
        at_rest = _SHORTED_M if "leaky-gap" in self.terms else float(h0)
        return torch.where(steady, at_rest, thickness)

    def _checked(self, name: str, value: Any, expected: str, zero: bool = False) -> Tensor:
        return checked(name, value, expected, self.contact.device, zero)

    def _check_limit(self, voltage: Tensor) -> None:
        highest = float(voltage.detach().max())
        if highest > self.screen.max_voltage_v:
            raise LimitError(
                f"voltage_v: {highest:g} V is above the limit of {self.screen.max_voltage_v:g} V "
                f"of screen {self.screen.name!r}; lower it (it is rejected, not clamped)"
            )
