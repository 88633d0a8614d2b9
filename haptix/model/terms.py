"""The terms of the contact model: effects that can be switched on and off by name.

Each term is one class of this file and a name in `TERM_NAMES`. Its methods change stages between a
load and its friction. `ActiveTerms` applies those that are on, stage by stage.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial, reduce
from math import inf
from operator import attrgetter
from typing import Any, ClassVar, Protocol

import numpy as np
import torch
from torch import Tensor

from haptix.base.checks import boolean
from haptix.base.errors import InputError
from haptix.model.contact import ElasticSolid, HalfSpace, Layered, MeanField
from haptix.model.electro import VACUUM_PERMITTIVITY, FieldLimit
from haptix.model.electro.breakdown import bearable_field, breaks_down
from haptix.model.finger import Finger
from haptix.model.presets import TERM_NAMES
from haptix.model.screen import Screen
from haptix.model.states import ContactState
from haptix.model.status import Status

PNAS_2018 = "Ayyildiz, Scaraggi, Sirin, Basdogan, Persson, PNAS 115, 12668 (2018)"

FieldInGap = Callable[[float], Tensor]
"""Magnitude of the field [V/m] in a gap of given width [m]; 0 is the edge of a contact spot."""


class Stage(StrEnum):
    """A stage between a load and its friction, named as the method by which a term changes it."""

    SOLID = "solid"
    SIZE = "size"
    INSULATORS = "insulators"
    PULL = "pull"
    GAPS = "gaps"
    HARDNESS = "hardness"
    SUPPLY = "supply"
    SHEAR = "shear"
    STATUS = "status"


@dataclass(frozen=True)
class Properties:
    """Finger and screen, as terms read them."""

    finger: Finger
    screen: Screen
    """Their fields are numbers, or tensors with one value per state."""
    unit_pa: float | Tensor = 1.0
    """Pressure that counts as 1 Pa in the fidelity's tables: a fit scales one to many moduli."""


class Term:
    """An effect that the contact model can leave out.

    A term overrides the methods of the stages that it changes. Each method gets the value of its
    stage so far, at first the one after "from" below, and returns the changed one. Terms act in
    the order of `haptix.model.terms.TERMS`.
    """

    name: ClassVar[str]
    summary: ClassVar[str]  # part of a surface's model hash: another wording is another model
    source: ClassVar[str]
    uses: ClassVar[tuple[str, ...]]
    """Fields that it reads, such as "finger.hardness_pa"; it is possible if all have a value."""
    needs_frequency: ClassVar[bool] = False
    """Whether a drive of unknown frequency is an error, or just leaves the term out."""
    on_request: ClassVar[bool] = False
    """Whether it is off unless requested. Others are on wherever they are possible."""
    left_to_scene: ClassVar[bool] = False
    """Whether planning only measures its effect, and switches it on only if the scene asks."""
    work: ClassVar[float] = 0.1
    """Largest share of a surface's build time that leaving it out saves; planning weighs it against
    the effect. Most save next to nothing, and get some credit for a simpler model."""
    reports: ClassVar[Status | None] = None
    """The status that it gives, if it gives one."""

    @property
    def stages(self) -> frozenset[Stage]:
        """Stages that it changes."""
        return frozenset(s for s in Stage if getattr(type(self), s) is not getattr(Term, s))

    @property
    def changes_friction(self) -> bool:
        """False if it gives a status and nothing else."""
        return self.stages != {Stage.STATUS}

    def parameters(self, finger: Finger, screen: Screen) -> dict[str, object]:
        """Values of the fields that it uses, by name."""
        properties = Properties(finger, screen)
        return {name: attrgetter(name)(properties) for name in self.uses}

    def missing(self, finger: Finger, screen: Screen) -> list[str]:
        """Fields that it uses and that the profiles do not have."""
        return [name for name, value in self.parameters(finger, screen).items() if value is None]

    def solid(self, solid: ElasticSolid, properties: Properties) -> ElasticSolid:
        """Elasticity of the finger; from a half-space of the stratum corneum."""
        return solid

    def size(self, area_m2: Tensor, normal_force_n: Tensor, properties: Properties) -> Tensor:
        """Apparent contact area [m^2] at normal forces [N]; from that at 1 N."""
        return area_m2

    def insulators(self, h0_m: Tensor, frequency_hz: Tensor, properties: Properties) -> Tensor:
        """Complex effective thickness [m] at frequencies [Hz]; from that of the screen's film."""
        return h0_m

    def pull(self, limit: FieldLimit | None, properties: Properties) -> FieldLimit | None:
        """Field [V/m] at which gaps are held; from None, for no limit."""
        return limit

    def gap_permittivity(self, frequency_hz: Tensor, properties: Properties) -> Tensor | float:
        """Complex eps_g of what fills the gap, at frequencies [Hz]; 1 for dry air.

        This is for the current; its effect on the field belongs to `insulators`.
        """
        return 1.0

    def gaps(self, widest_m: Tensor | None, area_m2: Tensor, contact: MeanField) -> Tensor | None:
        """Largest mean gap [m] of an apparent area [m^2]; from None, for no limit."""
        return widest_m

    def hardness(
        self, hardness_pa: float | Tensor | None, properties: Properties
    ) -> float | Tensor | None:
        """Stress [Pa] at which the skin yields; from None, for elastic skin."""
        return hardness_pa

    def supply(self, share: Tensor, capacitance_f: Tensor, properties: Properties) -> Tensor:
        """Complex share of the drive's voltage that a contact has; from all of it.

        `capacitance_f` is the contact's own complex capacitance, see `Circuit`.
        """
        return share

    def shear(self, stress_pa: float | Tensor, properties: Properties) -> float | Tensor:
        """Friction force per real contact area [Pa]; from the finger's tau_f."""
        return stress_pa

    def status(self, status: Tensor, field: FieldInGap, properties: Properties) -> Tensor:
        """`haptix.Status` of states; from OK, or PULL_IN where the light contact has ended."""
        return status

    def voltage_limit(self, state: ContactState) -> Tensor:
        """Amplitude [V] from which it reports its status; infinite without a status."""
        return torch.full_like(state.mu, inf)

    def placeholders(self, properties: Properties) -> list[str]:
        """Names of the unmeasured values that it rests on."""
        return []


class LayeredSkin(Term):
    """``E*(q)`` of a layer bonded to a half-space: long waves feel the tissue below."""

    name = "layered-skin"
    summary = "stratum corneum bonded to soft tissue; off: a half-space of the stratum corneum"
    source = f"{PNAS_2018}, SI; physics page, section 3"
    uses = ("finger.layer_thickness_m", "finger.bulk_modulus_pa", "finger.bulk_poisson_ratio")

    def solid(self, solid: ElasticSolid, properties: Properties) -> ElasticSolid:
        return properties.finger.solid()


class ApparentArea(Term):
    """``A0 = A0(1 N) (F_N / 1 N)^m``: a fingertip flattens as it presses."""

    name = "apparent-area"
    summary = "apparent contact area grows with force, A0 ~ F_N^m; off: its value at 1 N"
    source = f"{PNAS_2018}: 3 kPa at 0.1 N, 20 kPa at 0.9 N"
    uses = ("finger.apparent_area_at_1n_m2", "finger.apparent_area_exponent")

    def size(self, area_m2: Tensor, normal_force_n: Tensor, properties: Properties) -> Tensor:
        return properties.finger.apparent_area_m2(normal_force_n)


class FiniteSize(Term):
    """The mean gap is at most the highest asperity, by the law that the theory has for it."""

    name = "finite-size"
    summary = "the mean gap cannot exceed the highest asperity of the apparent contact"
    source = "physics page, section 2: h_rms sqrt(2 ln N)"
    uses = ("finger.roughness", "finger.apparent_area_at_1n_m2")
    on_request = True  # except for theories that have it among their usual terms
    work = 0.35  # 20,000 states took 0.158 s with it and 0.101 s without, on one core

    def gaps(self, widest_m: Tensor | None, area_m2: Tensor, contact: MeanField) -> Tensor | None:
        height = contact.highest_asperity(area_m2)
        return height if widest_m is None else torch.minimum(widest_m, height)


class Plasticity(Term):
    """The stress distribution is cut off at the hardness, see `haptix.model.contact.area`."""

    name = "plasticity"
    summary = "contact stress is cut off at the hardness, and the area that yields is added"
    source = "Persson, Phys. Rev. Lett. 87, 116101 (2001)"
    uses = ("finger.hardness_pa",)
    work = 0.2  # 20,000 states of a dry finger took 0.101 s with it and 0.080 s without

    def hardness(
        self, hardness_pa: float | Tensor | None, properties: Properties
    ) -> float | Tensor | None:
        return properties.finger.hardness_pa


class SkinInsulation(Term):
    """``h0 = d1/eps1 + d2/eps2(f)``. Without a frequency the skin counts as a conductor."""

    name = "skin-dielectric"
    summary = "the stratum corneum's d2/eps2(f) adds to h0, where a frequency is given"
    source = f"{PNAS_2018}, Eq. 4"
    uses = ("finger.layer_thickness_m", "finger.dielectric")

    def insulators(self, h0_m: Tensor, frequency_hz: Tensor, properties: Properties) -> Tensor:
        skin = properties.finger.dielectric
        return h0_m + properties.finger.layer_thickness_m / skin.relative_permittivity(frequency_hz)

    def placeholders(self, properties: Properties) -> list[str]:
        return ["dielectric of the skin"] if properties.finger.dielectric.is_placeholder else []


class LeakyGap(Term):
    """The gap conducts: ``eps_g = 1 + i/(w eps0 rho_g)`` multiplies h0.

    By continuity of the current ``E_gap = V / (u + eps_g h0)``.
    """

    name = "leaky-gap"
    summary = "the gap conducts: eps_g = 1 + i/(w eps0 rho_g) multiplies h0"
    source = f"{PNAS_2018}, Fig. 4; physics page, section 3"
    uses = ("screen.gap_resistivity_ohm_m",)
    needs_frequency = True

    def insulators(self, h0_m: Tensor, frequency_hz: Tensor, properties: Properties) -> Tensor:
        return h0_m * self.gap_permittivity(frequency_hz, properties)

    def gap_permittivity(self, frequency_hz: Tensor, properties: Properties) -> Tensor:
        resistivity = properties.screen.gap_resistivity_ohm_m
        assert resistivity is not None  # the term is not possible without
        leak = 1 / (2 * torch.pi * frequency_hz * VACUUM_PERMITTIVITY * resistivity)
        return torch.complex(torch.ones_like(leak), leak)


class FieldLimited(Term):
    """Each gap's field is held at its breakdown field: discharge leaks the rest.

    The attraction of a gap is then ``eps0/4 min(V0^2/|u + h0|^2, E_b(u)^2)``, with E_b of
    `haptix.model.electro.breakdown.bearable_field`. Contact spots have no gap and keep their
    attraction.
    """

    name = "field-limit"
    summary = "the field of each gap is held at what the gap bears, since discharge leaks the rest"
    source = "physics page, sections 3 and 9; arXiv 2409.18725"
    uses = ("screen.insulator_permittivity", "screen.insulator_strength_v_per_m")
    on_request = True
    left_to_scene = True

    def pull(self, limit: FieldLimit | None, properties: Properties) -> FieldLimit:
        screen = properties.screen
        return partial(
            bearable_field,
            insulator_permittivity=screen.insulator_permittivity,
            insulator_strength_v_per_m=screen.insulator_strength_v_per_m,
        )


class BodyReturn(Term):
    """Each of n equal contacts has ``C_b / (C_b + n C_c)`` of the voltage.

    They stand side by side on one electrode, in series with the body's capacitance to earth.
    """

    name = "body-return"
    summary = "the body's capacitance to earth takes a share of the voltage from all contacts"
    source = "series circuit; body of 100 pF (ANSI/ESDA/JEDEC JS-001) to 150 pF (IEC 61000-4-2)"
    uses = ("screen.body_capacitance_f", "finger.fingers_on_screen")
    on_request = True
    left_to_scene = True

    def supply(self, share: Tensor, capacitance_f: Tensor, properties: Properties) -> Tensor:
        body = properties.screen.body_capacitance_f
        return share * (body / (body + properties.finger.fingers_on_screen * capacitance_f))


class Breakdown(Term):
    """Reports `Status.BREAKDOWN`; friction does not change.

    The model's breakdown is a spark at the edge of a contact spot. Laboratories use such voltages
    every day, the paper's own 200 V on 1 um of SiO2 among them, so it is off unless requested.
    """

    name = "breakdown"
    summary = "report states whose field exceeds what air or the insulator bears"
    source = "physics page, section 3"
    uses = (
        "screen.insulator_thickness_m",
        "screen.insulator_permittivity",
        "screen.insulator_strength_v_per_m",
    )
    on_request = True
    reports = Status.BREAKDOWN

    def status(self, status: Tensor, field: FieldInGap, properties: Properties) -> Tensor:
        screen = properties.screen
        broken = breaks_down(
            field, screen.insulator_permittivity, screen.insulator_strength_v_per_m
        )
        return torch.where((status == Status.OK) & broken, int(Status.BREAKDOWN), status)

    def voltage_limit(self, state: ContactState) -> Tensor:
        return state.breakdown_voltage_v


class Occlusion(Term):
    """``E = E0 (r + (1 - r) exp(-t/tau))``: sweat softens the stratum corneum under the screen.

    Neither tau_f nor the roughness changes: the real area grows, and with it friction.
    """

    name = "occlusion"
    summary = "the stratum corneum softens while the screen covers it; off: as at the first touch"
    source = "Dzidek et al., PNAS 114, 10864 (2017): first-order, saturated within 20 s"
    uses = ("finger.contact_time_s", "finger.softening_time_s", "finger.softened_share")
    on_request = True
    left_to_scene = True

    def solid(self, solid: ElasticSolid, properties: Properties) -> ElasticSolid:
        share = float(self.share(properties.finger, properties.finger.contact_time_s))
        if isinstance(solid, Layered):
            return replace(solid, layer_modulus_pa=solid.layer_modulus_pa * share)
        assert isinstance(solid, HalfSpace)  # earlier terms make no other solid
        return replace(solid, youngs_modulus_pa=solid.youngs_modulus_pa * share)

    @staticmethod
    def share(finger: Finger, contact_time_s: Any) -> Any:
        """Share of the stratum corneum's modulus that is left after a time [s], or times."""
        least = finger.softened_share
        return least + (1 - least) * np.exp(-contact_time_s / finger.softening_time_s)


class SlidingSpeed(Term):
    """``tau_f (v / 30 mm/s)^k``: by a finger's own law, friction rises or falls with the speed.

    30 mm/s is the middle, in its logarithm, of the 5 to 200 mm/s at which k was measured.
    """

    name = "sliding-speed"
    summary = "tau_f goes as a power of the sliding speed over 30 mm/s; off: the same at any speed"
    source = "k from -0.2 to 0.3 by person and moisture; Pasumarty et al., Tribol. Lett. 44 (2011)"
    uses = ("finger.sliding_speed_mm_per_s", "finger.speed_exponent")
    on_request = True
    left_to_scene = True

    def shear(self, stress_pa: float | Tensor, properties: Properties) -> float | Tensor:
        finger = properties.finger
        factor: float = self.factor(finger, finger.sliding_speed_mm_per_s)
        return stress_pa * factor

    @staticmethod
    def factor(finger: Finger, speed_mm_per_s: Any) -> Any:
        """Factor of tau_f at a speed [mm/s], or an array of them."""
        return (speed_mm_per_s / 30.0) ** finger.speed_exponent


class ShearArea(Term):
    """``A0 (1 - loss)``: shear lifts the edge of the contact from the screen."""

    name = "shear-area"
    summary = "the apparent area of a sliding finger is smaller than at rest; off: that at rest"
    source = "10 to 30 %: Delhaye et al., J. R. Soc. Interface 11 (2014); Sahli et al., PNAS (2018)"
    uses = ("finger.shear_area_loss",)
    on_request = True
    left_to_scene = True

    def size(self, area_m2: Tensor, normal_force_n: Tensor, properties: Properties) -> Tensor:
        return area_m2 * (1 - properties.finger.shear_area_loss)


_KINDS = {kind.name: kind for kind in Term.__subclasses__()}
TERMS: dict[str, Term] = {name: _KINDS[name]() for name in TERM_NAMES}
"""All terms by name, in the order of `TERM_NAMES`, in which they act."""


class Honouring(Protocol):
    """Attributes of a fidelity, class or object, that terms need."""

    @property
    def name(self) -> str: ...
    @property
    def assumes(self) -> str: ...
    @property
    def honours(self) -> frozenset[Stage]: ...


def possible_terms(finger: Finger, screen: Screen, fidelity: Honouring) -> frozenset[str]:
    """Names of all terms that the profiles have the values for and the fidelity can honour.

    Examples
    --------
    >>> from haptix.model import FIDELITIES, Finger, Screen
    >>> possible_terms(Finger(), Screen(), FIDELITIES["mean-field"]) <= set(TERMS)
    True
    """
    return frozenset(
        name
        for name, term in TERMS.items()
        if term.stages <= fidelity.honours and not term.missing(finger, screen)
    )


def chosen_terms(
    terms: Iterable[str] | Mapping[str, bool] | None,
    finger: Finger,
    screen: Screen,
    fidelity: Honouring,
    of_theory: frozenset[str] = frozenset(),
) -> frozenset[str]:
    """Return the names of the terms that are on.

    Raises `InputError` if a name is unknown, or a term lacks a value or contradicts the fidelity.

    Parameters
    ----------
    terms : iterable of str, mapping, or None
        Names of all that are on; or a mapping that switches single ones, name to bool; or None for
        all possible ones that need no request.
    of_theory : frozenset of str
        Names of terms that need no request in the theory of the contact.
    """
    possible = possible_terms(finger, screen, fidelity)
    usual = {name for name in possible if not TERMS[name].on_request or name in of_theory}
    if terms is None:
        return frozenset(usual)
    if isinstance(terms, str):
        raise InputError(f"terms: expected a set of names, such as {{{terms!r}}}, got a string")
    unknown = set(terms) - set(TERMS)
    if unknown:
        raise InputError(
            f"terms: unknown {', '.join(map(repr, sorted(unknown)))}; expected any of "
            f"{', '.join(TERMS)}"
        )
    if isinstance(terms, Mapping):
        switched = {name: boolean(f"terms: {name}", on) for name, on in terms.items()}
        on = {name for name in TERMS if switched.get(name, name in usual)}
    else:
        on = set(terms)
    for name in sorted(on - possible):
        missing = TERMS[name].missing(finger, screen)
        if missing:
            raise InputError(
                f'terms: "{name}" needs {missing[0]}, which is None; set it or switch it off'
            )
        raise InputError(
            f'terms: "{name}" contradicts fidelity "{fidelity.name}", which {fidelity.assumes}; '
            "switch it off, or use another fidelity"
        )
    return frozenset(on)


_STEADY_HZ = 1e-9  # stands for 0 Hz: in a period of 30 years everything that leaks conducts


class ActiveTerms:
    """Properties of finger and screen with the terms that are on."""

    def __init__(self, properties: Properties, names: Iterable[str]) -> None:
        on = set(names)
        self.properties = properties
        self.all = tuple(term for name, term in TERMS.items() if name in on)
        self.stages = frozenset[Stage]().union(*(term.stages for term in self.all))

    def solid(self) -> ElasticSolid:
        """The elastic solid, from a half-space of the stratum corneum."""
        finger = self.properties.finger
        base: ElasticSolid = HalfSpace(finger.youngs_modulus_pa, finger.poisson_ratio)
        return reduce(lambda solid, term: term.solid(solid, self.properties), self.all, base)

    def hardness_pa(self) -> float | Tensor | None:
        """Stress [Pa] at which the skin yields; None for elastic skin."""
        none: float | Tensor | None = None
        return reduce(
            lambda hardness, term: term.hardness(hardness, self.properties), self.all, none
        )

    def apparent_area_m2(self, normal_force_n: Tensor) -> Tensor:
        """A0 [m^2] at normal forces [N] of any shape, from that at 1 N."""
        at_1n = self.properties.finger.apparent_area_m2(torch.ones_like(normal_force_n))
        return reduce(
            lambda area, term: term.size(area, normal_force_n, self.properties), self.all, at_1n
        )

    def widest_gap_m(self, area_m2: Tensor, contact: MeanField) -> Tensor | None:
        """Largest mean gap [m] at apparent areas [m^2]; None for no limit."""
        none: Tensor | None = None
        return reduce(lambda widest, term: term.gaps(widest, area_m2, contact), self.all, none)

    def thickness(self, h0_m: Tensor, frequency_hz: Tensor | None) -> Tensor:
        """Complex effective thickness [m] of everything that insulates, from that of the film.

        Frequencies [Hz] broadcast with `h0_m`; 0 is a steady voltage. Without one the skin counts
        as a conductor, and `h0_m` is returned unchanged, unless a term needs a frequency: that is
        an `InputError`.
        """
        if frequency_hz is None:
            if needing := [term.name for term in self.all if term.needs_frequency]:
                raise InputError(
                    f'frequency_hz: expected one, since the term "{needing[0]}" depends on it; '
                    "give one or switch the term off"
                )
            return h0_m
        frequency = frequency_hz.clamp(min=_STEADY_HZ)
        thickness = torch.complex(h0_m, torch.zeros_like(h0_m))
        for term in self.all:
            thickness = term.insulators(thickness, frequency, self.properties)
        return thickness.expand(np.broadcast_shapes(h0_m.shape, frequency.shape))

    def field_limit(self) -> FieldLimit | None:
        """Field [V/m] at which gaps are held; None for no limit."""
        none: FieldLimit | None = None
        return reduce(lambda limit, term: term.pull(limit, self.properties), self.all, none)

    def gap_permittivity(self, frequency_hz: Tensor) -> Tensor | float:
        """Complex eps_g of what fills the gap, at frequencies [Hz]."""
        permittivity: Tensor | float = 1.0  # of dry air
        for term in self.all:
            permittivity = permittivity * term.gap_permittivity(frequency_hz, self.properties)
        return permittivity

    def voltage_share(self, capacitance_f: Tensor) -> Tensor:
        """Complex share of the drive's voltage that contacts of a capacitance [F] have."""
        whole = torch.ones_like(capacitance_f)
        return reduce(
            lambda share, term: term.supply(share, capacitance_f, self.properties), self.all, whole
        )

    def status(self, is_stable: Tensor, field: FieldInGap) -> Tensor:
        """`haptix.Status` of states whose light contact holds or not, given their field."""
        light = torch.where(is_stable, int(Status.OK), int(Status.PULL_IN))
        return reduce(
            lambda status, term: term.status(status, field, self.properties), self.all, light
        )

    def shear_stress_pa(self) -> float | Tensor:
        """Friction force per real contact area [Pa], from tau_f."""
        stress: float | Tensor = self.properties.finger.frictional_shear_stress_pa
        return reduce(lambda stress, term: term.shear(stress, self.properties), self.all, stress)

    def placeholders(self) -> list[str]:
        """Names of the unmeasured values that the terms rest on."""
        return [name for term in self.all for name in term.placeholders(self.properties)]
