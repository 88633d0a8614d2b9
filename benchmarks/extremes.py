"""What the contact model does far from the finger it was made for.

    .venv/bin/python benchmarks/extremes.py            # some minutes; writes docs/extremes.md
    .venv/bin/python benchmarks/extremes.py --quick    # one contact a region, printed only

Random contacts in named regions: one for each extreme, one for each term, and all at once.
"""

import argparse
import platform
import random
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, fields, replace
from multiprocessing import get_context
from pathlib import Path
from statistics import mean, median
from typing import Any

import torch
from oracle import (
    CORRECTED,
    LIGHT,
    PUBLISHED,
    Oracle,
    SelfAffine,
    Solid,
    State,
    breaks_down,
    leaking,
    thickness,
)
from scipy.special import erfinv

from haptix import ContactModel, Finger, Screen, Status
from haptix.model.contact import RoughnessSpectrum, TheoryName
from haptix.model.finger import Roughness
from haptix.model.states import ContactState

REPORT = Path(__file__).parent.parent / "docs" / "extremes.md"
CONTACTS, QUICK = 4, 1  # per region
REFERENCES = 2  # states per contact that are solved by the slow solver
CLOSED_FORM_AT_N = 0.5  # the force at which the closed form takes its Lambda
WORKERS = 2
SEED = 20180101

Range = tuple[float, float]

USUAL: Mapping[str, Range] = {
    "force_n": (0.1, 1.0),
    "voltage_v": (10.0, 300.0),
    "frequency_hz": (1e2, 1e5),
    "h0_m": (1e-7, 2e-6),
    "modulus_pa": (1e7, 1e9),
    "h_rms_m": (5e-6, 3e-5),
    "slope": (0.3, 1.0),
    "contrast": (1e2, 1e4),
    "decades": (4.0, 6.0),
    "hardness": (1e-2, 1.0),  # over Young's modulus
    "gap_resistivity": (1e4, 1e9),
    "body_f": (1e-11, 3e-10),
}
"""The surroundings of the paper's finger and screen; every number is drawn log-uniformly."""

WIDEST: Mapping[str, Range] = {
    "force_n": (1e-4, 1e2),
    "voltage_v": (0.1, 5e3),
    "frequency_hz": (1e-2, 1e7),
    "h0_m": (1e-10, 1e-3),
    "modulus_pa": (1e3, 1e12),
    "h_rms_m": (1e-9, 1e-3),
    "slope": (1e-4, 10.0),
    "contrast": (1e-6, 1e6),
    "gamma": (0.3, 0.6),
    "decades": (2.0, 6.0),
}


@dataclass(frozen=True)
class Region:
    """Ranges that replace the usual ones, and options of the model; "on" names more terms."""

    name: str
    ranges: Mapping[str, Range] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)


INCLUDED = {"contact_spots": "included"}
PUBLISHED_GAPS = {"theory": "open-gaps", "terms": {"finite-size": True}}
CLOSED_FORM = {"fidelity": "closed-form"}
NOT_IN_CLOSED_FORM = ["finite-size", "plasticity", "field-limit", "body-return"]
CIRCUIT = ["field-limit", "body-return"]
EVERY_TERM = {"on": ["plasticity", "leaky-gap", *CIRCUIT]} | INCLUDED
REGIONS = (
    Region("the finger's own surroundings"),
    Region("forces of 0.1 to 10 mN", {"force_n": (1e-4, 1e-2)}),
    Region("forces of 10 to 100 N", {"force_n": (10.0, 1e2)}),
    Region("voltages of 1 to 5 kV", {"voltage_v": (1e3, 5e3)}),
    Region("frequencies of 0.01 to 1 Hz", {"frequency_hz": (1e-2, 1.0)}),
    Region("frequencies of 1 to 10 MHz", {"frequency_hz": (1e6, 1e7)}),
    Region("h0 of 0.1 to 10 nm", {"h0_m": (1e-10, 1e-8)}),
    Region("h0 of 0.01 to 1 mm", {"h0_m": (1e-5, 1e-3)}),
    Region("moduli of 1 to 100 kPa", {"modulus_pa": (1e3, 1e5)}),
    Region("moduli of 10 GPa to 1 TPa", {"modulus_pa": (1e10, 1e12)}),
    Region("roughness of 1 to 100 nm", {"h_rms_m": (1e-9, 1e-7)}),
    Region("roughness of 0.1 to 1 mm", {"h_rms_m": (1e-4, 1e-3)}),
    Region("slopes of 1e-4 to 1e-2", {"slope": (1e-4, 1e-2)}),
    Region("slopes of 2 to 10", {"slope": (2.0, 10.0)}),
    Region("layer 1e4 to 1e6 times stiffer", {"contrast": (1e4, 1e6)}),
    Region("layer 1e3 to 1e6 times softer", {"contrast": (1e-6, 1e-3)}),
    Region("gamma of 0.3 to 0.6", {"gamma": (0.3, 0.6)}),
    Region("two decades of roughness", {"decades": (2.0, 2.5)}),
    Region("six decades of roughness", {"decades": (5.8, 6.0)}),
    Region("spots included", options=INCLUDED),
    Region("infinite contact", options={"terms": {"finite-size": False}}),
    Region("finite size, 0.1 mN to 1 N", {"force_n": (1e-4, 1.0)}),
    Region("finite size, 0.1 mN to 1 N, spots included", {"force_n": (1e-4, 1.0)}, INCLUDED),
    Region("open gaps", options={"theory": "open-gaps"}),
    Region("as published", options={"theory": "as-published"}),
    Region("open gaps, finite size, 0.1 mN to 1 N", {"force_n": (1e-4, 1.0)}, PUBLISHED_GAPS),
    Region("gaps held at what they bear", options={"on": ["field-limit"]}),
    Region("body of 10 to 300 pF in series", options={"on": ["body-return"]}),
    Region("plasticity", options={"on": ["plasticity"]}),
    Region(
        "plasticity, hardness of 1e-5 to 1e-2 E, spots included",
        {"hardness": (1e-5, 1e-2)},
        {"on": ["plasticity"]} | INCLUDED,
    ),
    Region("leaky gap, 0.01 Hz to 10 MHz", {"frequency_hz": (1e-2, 1e7)}, {"on": ["leaky-gap"]}),
    Region("every term on, spots included", options=EVERY_TERM),
    Region("closed form, usual surroundings", options=CLOSED_FORM),
    Region(
        "closed form, smooth skin of 1 to 100 kPa",
        {"modulus_pa": (1e3, 1e5), "slope": (1e-4, 1e-2)},
        CLOSED_FORM,
    ),
    Region("closed form, everything at once", WIDEST, CLOSED_FORM),
    Region("everything at once", WIDEST),
    Region("everything at once, spots included", WIDEST, INCLUDED),
    Region("everything at once, every term on, spots included", WIDEST, EVERY_TERM),
)
FLOATS = [f.name for f in fields(ContactState) if f.name not in ("find_status", "sum_gaps")]
FLOATS += ["pull_past_breakdown", "capacitance_f", "conductance_s"]


@dataclass(frozen=True)
class Case:
    """A state for the slow solver."""

    oracle: Mapping[str, Any]
    state: State
    near_pa: float


@dataclass
class Tally:
    """Results of one region."""

    states: int = 0
    status: Counter[int] = field(default_factory=Counter)
    not_finite: int = 0
    outside: float = 0.0
    fall_with_voltage: float = 0.0
    rise_with_thickness: float = 0.0
    single: float = 0.0
    mu: float = -1.0
    area: float = 0.0
    attraction: float = 0.0
    gap: float = 0.0
    references: int = 0
    status_checks: int = 0
    status_wrong: int = 0
    worst: Case | None = None
    apart: dict[str, list[float]] = field(default_factory=dict)
    """Closed form from mean field, by load; and 1 where exactly one of them is past pull-in."""


class Draw:
    """Random numbers of one contact."""

    def __init__(self, region: Region, number: int) -> None:
        self.random = random.Random(f"{SEED} {region.name} {number}")
        self.ranges = {**USUAL, **region.ranges}

    def __call__(self, name: str) -> float:
        low, high = self.ranges[name]
        return low * (high / low) ** self.random.random()

    def several(self, name: str, count: int) -> torch.Tensor:
        return torch.tensor(sorted(self(name) for _ in range(count)), dtype=torch.float64)


def finger_and_screen(draw: Draw, on: Sequence[str], theory: TheoryName) -> tuple[Finger, Screen]:
    hurst, rolloff, decades = (
        draw.random.uniform(0.5, 1),
        10 ** draw.random.random(),
        draw("decades"),
    )
    # A spectrum of h_rms 1 m from 1 /m on: its slope gives the q0 of the slope asked for.
    unit = RoughnessSpectrum.self_affine(1.0, hurst, 1.0, rolloff, 10**decades)
    h_rms = draw("h_rms_m")
    q0 = draw("slope") / h_rms / float(unit.slope_rms)
    modulus = draw("modulus_pa")
    finger = Finger(
        youngs_modulus_pa=modulus,
        poisson_ratio=draw.random.uniform(0.2, 0.5),
        layer_thickness_m=10 ** draw.random.uniform(-4.5, -3),
        bulk_modulus_pa=modulus / draw("contrast"),
        bulk_poisson_ratio=draw.random.uniform(0.2, 0.5),
        hardness_pa=modulus * draw("hardness") if "plasticity" in on else None,
        fingers_on_screen=draw.random.randint(1, 3) if "body-return" in on else 1,
        theory=theory,
        roughness=Roughness(
            h_rms_m=h_rms,
            hurst=hurst,
            q0_per_m=q0,
            q_rolloff_per_m=q0 * rolloff,
            q1_per_m=q0 * 10**decades,
        ),
    )
    resistivity = draw("gap_resistivity") if "leaky-gap" in on else None
    screen = Screen(max_voltage_v=5000.0, gap_resistivity_ohm_m=resistivity)
    return finger, screen.replace(
        body_capacitance_f=draw("body_f")
    ) if "body-return" in on else screen


def run(job: tuple[int, int]) -> tuple[int, Tally]:
    """Solve one contact of one region."""
    region = REGIONS[job[0]]
    draw = Draw(region, job[1])
    options = dict(region.options)
    on = options.pop("on", ())
    finger, screen = finger_and_screen(draw, on, options.pop("theory", "corrected"))
    options["terms"] = options.get("terms", {}) | dict.fromkeys([*on, "breakdown"], True)
    if "gamma" in draw.ranges:
        options["gamma"] = draw("gamma")
    model = ContactModel(finger, screen, **options)
    tally = Tally()

    force = draw.several("force_n", 4)[:, None, None]
    h0 = draw.several("h0_m", 4)[:, None]
    frequency = draw("frequency_hz")
    common = torch.cat([force.new_zeros(1), draw.several("voltage_v", 5)])
    plain = model.solve(force, common, frequency, h0)
    # Voltages up to the end of each branch, where they are within the screen's limit.
    shares = torch.tensor([0.3, 0.8, 0.95, 0.999], dtype=torch.float64)
    end = torch.nan_to_num(plain.pull_in_voltage_v[..., :1], posinf=1e300)
    voltage = torch.cat([common.expand(4, 4, 6), end * shares], -1)
    voltage = voltage.clamp(max=screen.max_voltage_v).sort(-1).values
    state = model.solve(force, voltage, frequency, h0)
    single = ContactModel(finger, screen, dtype=torch.float32, **options)
    narrow = single.solve(force, voltage, frequency, h0)

    tally.states = plain.mu.numel() + 2 * state.mu.numel()
    tally.status.update((torch.cat([plain.status, state.status], -1)).flatten().tolist())
    for found in (plain, state, narrow):
        for name in FLOATS:
            # Gaps that are held may leave light contact without an end.
            is_end = name == "pull_in_voltage_v" and "field-limit" in model.terms
            values = getattr(found, name)
            tally.not_finite += int((values.isnan() if is_end else ~values.isfinite()).sum())
        area = found.area_fraction
        tally.outside = max(tally.outside, float((area - 1).max()), float(-area.min()))
    tally.fall_with_voltage = fall(state, -1)
    tally.rise_with_thickness = rise(plain, 1)
    tally.single = float((narrow.mu.double() / state.mu - 1).abs().max())
    at = force, voltage, frequency, h0
    compare(tally, model, at, state)
    if model.fidelity == "mean-field":
        light = options | CLOSED_FORM
        light["terms"] = options["terms"] | dict.fromkeys(NOT_IN_CLOSED_FORM, False)
        closed = ContactModel(finger, screen, **light).solve(*at)
        tally.apart = apart(closed, state, force / finger.apparent_area_m2(force))
    return job[0], tally


def apart(
    closed: ContactState, full: ContactState, applied: torch.Tensor
) -> dict[str, list[float]]:
    """Relative difference of mu, closed form from mean field, by the ratio of attraction to p0."""
    snapped, ends = (found.status == int(Status.PULL_IN) for found in (closed, full))
    difference = (closed.mu / full.mu - 1).abs()
    light = ~snapped & ~ends
    lift = full.pressure_pa / applied
    found = {
        "little": difference[light & (lift <= 1.1)],
        "double": difference[light & (lift > 1.1) & (lift <= 2)],
        "more": difference[light & (lift > 2)],
        "early": (snapped & ~ends).double().flatten(),
        "late": (~snapped & ends).double().flatten(),
    }
    return {name: values.tolist() for name, values in found.items()}


def on_branch(state: ContactState, axis: int) -> torch.Tensor:
    """Whether both neighbours along an axis lie on the light branch."""
    light = state.status != int(Status.PULL_IN)
    count = light.shape[axis] - 1
    return light.narrow(axis, 0, count) & light.narrow(axis, 1, count)


def rise(state: ContactState, axis: int, sign: float = 1.0) -> float:
    """Largest relative rise of mu along an axis."""
    step = sign * state.mu.diff(dim=axis) / state.mu.narrow(axis, 1, state.mu.shape[axis] - 1)
    return (
        max(0.0, float(step[on_branch(state, axis)].amax()))
        if on_branch(state, axis).any()
        else 0.0
    )


def fall(state: ContactState, axis: int) -> float:
    """Largest relative fall of mu along an axis."""
    return rise(state, axis, -1.0)


def slow_solver(model: ContactModel) -> dict[str, Any]:
    """Inputs of the slow solver for a contact."""
    finger, rough = model.finger, model.finger.roughness
    return {
        "rough": SelfAffine(
            float(rough.h_rms_m),
            rough.hurst,
            rough.q0_per_m,
            rough.q_rolloff_per_m,
            rough.q1_per_m,
        ),
        "solid": Solid(
            float(finger.youngs_modulus_pa),
            finger.poisson_ratio,
            float(finger.layer_thickness_m),
            float(finger.bulk_modulus_pa),
            finger.bulk_poisson_ratio,
        ),
        "theory": replace(
            CORRECTED if model.theory == "corrected" else PUBLISHED, gamma=model.contact.gamma
        ),
        "hardness": finger.hardness_pa,
    }


def compare(tally: Tally, model: ContactModel, at: tuple[Any, ...], state: ContactState) -> None:
    """Solve some states under voltage with the slow solver, and one that snapped in."""
    force, voltage, frequency, h0 = at
    force, h0 = (t.expand_as(voltage) for t in (force, h0))
    pulled_in = state.status == int(Status.PULL_IN)
    lift = state.pressure_pa / (force / model.finger.apparent_area_m2(force))
    # Within 0.97 of the end: closer, an error of I is multiplied by more than ten.
    good = ~pulled_in & (voltage < 0.97 * state.pull_in_voltage_v)
    felt = good & (lift > 1.02)
    where = (felt if felt.any() else good).nonzero().tolist()
    draw = random.Random(str(where))
    chosen = draw.sample(where, min(REFERENCES, len(where)))
    snapped = (pulled_in & (voltage > 1.03 * state.pull_in_voltage_v)).nonzero().tolist()
    chosen += draw.sample(snapped, min(1, len(snapped)))
    told = slow_solver(model)
    # Where gaps are held, the strips that the oracle sums stand out of the gaps' distribution.
    oracle = Oracle(**told, fineness=2.0 if "field-limit" in model.terms else 1.0)
    reference = CLOSED_FORM_AT_N / nominal_area(model, CLOSED_FORM_AT_N)
    for place in map(tuple, chosen):
        newton, volt = float(force[place]), float(voltage[place])
        area = nominal_area(model, newton)
        insulators = effective(model, float(h0[place]), frequency)
        touching = 0.0
        if "finite-size" in model.terms:
            touching = oracle.touching_pressure(oracle.height(told["rough"], area))
        spots = model.contact_spots == "included"
        case = State(
            newton / area,
            volt,
            insulators,
            spots,
            touching,
            held="field-limit" in model.terms,
            body=model.screen.body_capacitance_f if "body-return" in model.terms else None,
            fingers=model.finger.fingers_on_screen,
            area=area,
            medium=leaking(frequency, model.screen.gap_resistivity_ohm_m),
        )
        found = {
            name: float(getattr(state, name)[place])
            for name in ("mu", "area_fraction", "pressure_pa", "gap_attraction_pa", "mean_gap_m")
        }
        pressure = found["pressure_pa"]
        is_closed_form = model.fidelity == "closed-form"
        critical = oracle.critical_voltage(reference, insulators, spots) if is_closed_form else 0.0
        tally.status_checks += 1
        if place in map(tuple, snapped):
            limit = LIGHT * oracle.of_gap(case.applied, touching)
            tally.status_wrong += not (
                volt > critical * (1 - 1 / LIGHT) ** 0.5
                if is_closed_form
                else oracle.nothing_below(case, limit, (0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0))
            )
            continue
        screen = model.screen
        expected = breaks_down(
            volt * oracle.left(pressure, case),
            insulators,
            screen.insulator_permittivity,
            screen.insulator_strength_v_per_m,
        )
        is_right = expected == (int(state.status[place]) == int(Status.BREAKDOWN))
        if is_closed_form:
            is_right &= volt <= critical * (1 - 1 / LIGHT) ** 0.5
            share = oracle.closed_form_area(case.applied, volt, critical, reference)
            area_there = oracle.closed_form_area(pressure, 0.0, critical, reference)
            gaps_pa = case.strength * oracle.gap_attraction(reference, insulators)
            gaps_pa *= pressure / reference
        else:
            root = oracle.equilibrium(case, pressure)
            is_right &= oracle.nothing_below(case, root, (0.3, 0.7))
            share = oracle.area_fraction(root)
            area_there = oracle.area_fraction(pressure)
            gaps_pa = case.strength * oracle.attraction(pressure, replace(case, spots=False))
            gap = oracle.mean_gap(pressure, touching)
            # A contact this closed has hardly any open gap, in either theory.
            if gap > 1e-9 * told["rough"].h_rms:
                tally.gap = max(tally.gap, abs(found["mean_gap_m"] / gap - 1))
        tally.status_wrong += not is_right
        tally.references += 1
        mu = float(model.finger.frictional_shear_stress_pa) * share * area / newton
        error = abs(found["mu"] / mu - 1)
        if error > tally.mu:
            tally.mu, tally.worst = error, None if is_closed_form else Case(told, case, root)
        tally.area = max(tally.area, abs(found["area_fraction"] / area_there - 1))
        # In complete contact no gap is left to attract.
        if gaps_pa > 1e-9 * case.applied:
            error = abs(found["gap_attraction_pa"] / gaps_pa - 1)
            tally.attraction = max(tally.attraction, error)


def nominal_area(model: ContactModel, newton: float) -> float:
    finger = model.finger
    return float(finger.apparent_area_at_1n_m2 * newton**finger.apparent_area_exponent)


def effective(model: ContactModel, h0: float, frequency: float) -> complex:
    skin = model.finger.dielectric
    table = skin.frequency_hz, skin.permittivity, skin.resistivity_ohm_m
    depth = float(model.finger.layer_thickness_m)
    return thickness(h0, frequency, depth, table, model.screen.gap_resistivity_ohm_m)


def own_error(case: Case | None) -> float | None:
    """By how much the slow solver's mu moves at twice its resolution."""
    if case is None:
        return None
    areas = []
    for fineness in (1.0, 2.0):
        oracle = Oracle(**case.oracle, fineness=fineness)
        areas.append(oracle.area_fraction(oracle.equilibrium(case.state, case.near_pa)))
    return abs(areas[0] / areas[1] - 1)


def merge(tallies: Sequence[Tally]) -> Tally:
    whole = Tally(worst=max(tallies, key=lambda one: one.mu).worst)
    for one in tallies:
        whole.status.update(one.status)
        for name in ("states", "not_finite", "references", "status_checks", "status_wrong"):
            setattr(whole, name, getattr(whole, name) + getattr(one, name))
        for name in (
            *("outside", "fall_with_voltage", "rise_with_thickness", "single"),
            *("mu", "area", "attraction", "gap"),
        ):
            setattr(whole, name, max(getattr(whole, name), getattr(one, name)))
        for name, values in one.apart.items():
            whole.apart.setdefault(name, []).extend(values)
    return whole


def quiet(value: float | None) -> str:
    return "-" if value is None or value < 0 else "0" if value == 0 else f"{value:.0e}"


def line(*cells: str) -> str:
    return "| " + " | ".join(cells) + " |"


def status_row(name: str, tally: Tally) -> str:
    count = sum(tally.status.values())
    shares = [
        f"{100 * tally.status[int(s)] / count:.0f}"
        for s in (Status.OK, Status.BREAKDOWN, Status.PULL_IN)
    ]
    return line(
        name,
        f"{tally.states:,}",
        *shares,
        str(tally.not_finite),
        quiet(tally.single),
        quiet(tally.outside),
        quiet(tally.fall_with_voltage),
        quiet(tally.rise_with_thickness),
    )


def reference_row(name: str, tally: Tally, own: float | None) -> str:
    return line(
        name,
        str(tally.references),
        quiet(tally.mu),
        quiet(own),
        quiet(tally.area),
        quiet(tally.attraction),
        quiet(tally.gap if tally.worst else None),
        f"{tally.status_wrong} of {tally.status_checks}",
    )


def apart_row(name: str, tally: Tally) -> str:
    def cell(values: list[float]) -> str:
        return f"{quiet(median(values))}, {quiet(max(values))}" if values else "-"

    cells = [cell(tally.apart[name]) for name in ("little", "double", "more")]
    shares = [f"{100 * mean(tally.apart[name]):.0f}" for name in ("early", "late")]
    return line(name, *cells, *shares)


STATUS = {
    "region": "which numbers have another range, which terms are on",
    "states": "number of solved states",
    "OK": "share of the states with that status, per cent",
    "broken": "share past breakdown of gap or insulator, per cent",
    "pulled in": "share past the end of the light contact, per cent",
    "not finite": "values, in any field of any state, that are NaN or infinite; with gaps held, a "
    "pull-in that is never met counts as a value",
    "single": "largest relative difference of mu between float32 and float64 results",
    "outside": "largest distance of A/A0 from the range 0 to 1",
    "falls": "largest relative fall of mu as the voltage rises, on the light branch",
    "rises": "largest relative rise of mu as h0 grows, on the light branch",
}
REFERENCE = {
    "region": "as above",
    "solved": "states, up to 0.97 of pull-in, that the slow solver solved too",
    "mu": "largest relative difference of mu, and so of A/A0, in equilibrium",
    "own": "change of the slow solver's own mu, in that state, at twice its resolution",
    "A/A0": "largest relative difference of A/A0 at one pressure",
    "attraction": "the same of the attraction in open gaps",
    "gap": "the same of the mean gap",
    "status": "states of another status by the slow solver, of those compared: "
    "breakdown, an equilibrium at less pressure, or one where there should be none",
}
APART = {
    "region": "as above, without the closed form's own",
    "to 1.1": "where the attraction is up to a tenth of the applied pressure: median and largest "
    "of the relative differences of mu",
    "to 2": "the same where it is up to the applied pressure",
    "above": "the same above, where both find light contact",
    "early": "share of the states past pull-in by the closed form alone, per cent",
    "late": "share of the states past pull-in by the mean field alone, per cent",
}

TEXT = """\
# The contact model at its extremes

Each region has {contacts} random contacts. Every number is drawn log-uniformly from the region's
ranges; a number that the region does not name is drawn from the usual range of a finger.
"Everything at once" draws all numbers from their widest ranges:
{widest}.
The theory is the default, "corrected", where a region does not name another.
Each contact is solved at 4 forces, 4 insulators h0 and one frequency, at voltages drawn from the
region and at 0.3 to 0.999 of each pull-in voltage up to 5 kV, in double and in single precision.

## States

{status}

## Against a slow solver

`benchmarks/oracle.py` shares no code with the package. It has the corrected and the published
theory and every term: finite size, plasticity, leaky gap, the skin's dielectric, both gap
distributions, spots, gaps held at what they bear, the body's return, and the critical-voltage
formula.

{reference}

The error of mu is larger than that of the attraction. The attraction presses on the contact that
causes it, which amplifies an error up to thirtyfold near the end of light contact. Where "own" is
far below "mu", the error is the package's, whose grids are made for speed.

With combined gaps both solvers drop the strips that are closed to double precision (p/tau beyond
5.6), since these have no width. Counted as gaps of zero, they would add {light} to the attraction
of the paper's finger at 20 kPa and h0 = 0.2 um. Where A/A0 is 0.9995 they would multiply it by
{full}. In nearly complete contact the attraction of combined gaps depends on this choice.

## The closed form against the mean field

The closed form takes I/p at {at_n} N. It has neither finite size, plasticity, held gaps nor the
body's return; where these terms are on the difference contains their effect. The closed form lets
I grow in proportion to p. In fact I grows a little slower, so the closed form ends light contact
too early, or too late at forces far below {at_n} N. Use it for mild voltages and forces near
{at_n} N, and not to estimate pull-in.

{apart}

Made by `python benchmarks/extremes.py` in {seconds:.0f} s:
{machine}.
"""


def table(columns: Mapping[str, str], rows: Sequence[str]) -> str:
    legend = [line("column", "meaning"), "|---|---|", *(line(*item) for item in columns.items())]
    return "\n".join([*legend, "", line(*columns), "|" + "---|" * len(columns), *rows])


def closed_strips(pressure: float | None = None) -> float:
    """Attraction of combined gaps with the closed strips counted, over that without them."""
    rough, solid = SelfAffine(22e-6, 0.86, 1e3, 3992.9, 1e9), Solid(40e6, 0.5, 200e-6, 10e3)
    dropped, kept = (
        Oracle(rough, solid, CORRECTED, fineness=2, keep_closed=keep) for keep in (False, True)
    )
    if pressure is None:
        pressure = dropped.tau * CORRECTED.stretched(float(erfinv(0.9995)))
    return kept.gap_attraction(pressure, 2e-7 + 0j) / dropped.gap_attraction(pressure, 2e-7 + 0j)


def one_thread() -> None:
    torch.set_num_threads(1)


def main() -> None:
    options = argparse.ArgumentParser(description="The contact model at its extremes.")
    options.add_argument("--quick", action="store_true", help="few contacts; writes no document")
    contacts = QUICK if options.parse_args().quick else CONTACTS
    began = time.perf_counter()
    jobs = [(r, number) for r in range(len(REGIONS)) for number in range(contacts)]
    found: list[list[Tally]] = [[] for _ in REGIONS]
    # Forked processes would inherit torch's threads in an unusable state.
    with ProcessPoolExecutor(WORKERS, get_context("spawn"), one_thread) as pool:
        for index, tally in pool.map(run, jobs):
            found[index].append(tally)
            if len(found[index]) == contacts:
                passed = time.perf_counter() - began
                whole = merge(found[index])
                print(f"{passed:5.0f} s  {status_row(REGIONS[index].name, whole)}", flush=True)
                print(f"         {reference_row('', whole, None)}", flush=True)
        wholes = [merge(tallies) for tallies in found]
        own = list(pool.map(own_error, [whole.worst for whole in wholes]))
    named = list(zip([region.name for region in REGIONS], wholes, own, strict=True))
    text = TEXT.format(
        contacts=contacts,
        widest=",\n".join(f"{name} {low:g} to {high:g}" for name, (low, high) in WIDEST.items()),
        status=table(STATUS, [status_row(name, whole) for name, whole, _ in named]),
        reference=table(REFERENCE, [reference_row(*each) for each in named]),
        apart=table(APART, [apart_row(name, whole) for name, whole, _ in named if whole.apart]),
        light=f"{100 * (closed_strips(20e3) - 1):.1f} per cent",
        full=f"{closed_strips():.1f}",
        at_n=CLOSED_FORM_AT_N,
        seconds=time.perf_counter() - began,
        machine=f"{platform.machine()}, {WORKERS} processes of one thread each, "
        f"Python {platform.python_version()}, torch {torch.__version__.split('+')[0]}",
    )
    if contacts == CONTACTS:
        REPORT.parent.mkdir(exist_ok=True)
        REPORT.write_text(text, encoding="utf-8")
        print(f"wrote {REPORT.parent.name}/{REPORT.name}")
    else:
        print(text)


if __name__ == "__main__":
    main()
