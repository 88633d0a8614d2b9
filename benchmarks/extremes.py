"""What the contact model does far from the finger it was made for.

    .venv/bin/python benchmarks/extremes.py

Random contacts in named regions, one for each extreme and one for all at once. Writes
docs/extremes.md; takes some minutes on two cores.
"""

import platform
import random
import time
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, fields
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import torch
from oracle import EPS0, Oracle, SelfAffine, Solid

from haptix import ContactModel, Finger, Screen, Status
from haptix.contact import RoughnessSpectrum
from haptix.finger import Roughness
from haptix.friction import ContactState

REPORT = Path(__file__).parent.parent / "docs" / "extremes.md"
CONTACTS = 10  # per region
REFERENCES = 2  # states per contact that are solved by the slow solver
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
    "gamma": (0.44, 0.46),
    "decades": (4.0, 6.0),
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
    """Ranges that replace the usual ones, and options of the model."""

    name: str
    ranges: Mapping[str, Range] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)


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
    Region(
        "every term on, combined gaps, spots included",
        options={"every_term": True, "gap_distribution": "combined", "contact_spots": "included"},
    ),
    Region("closed form, usual surroundings", options={"fidelity": "closed-form"}),
    Region(
        "closed form, smooth skin of 1 to 100 kPa",
        {"modulus_pa": (1e3, 1e5), "slope": (1e-4, 1e-2)},
        {"fidelity": "closed-form"},
    ),
    Region("closed form, everything at once", WIDEST, {"fidelity": "closed-form"}),
    Region("everything at once", WIDEST),
    Region("everything at once, spots included", WIDEST, {"contact_spots": "included"}),
)
FLOATS = [f.name for f in fields(ContactState) if f.name != "status"]
# The slow solver has the plain gap distribution and no terms beyond skin and screen.
WITHOUT_REFERENCE = ("every_term", "gap_distribution", "fidelity")


@dataclass
class Tally:
    """What a region came to."""

    states: int = 0
    status: Counter[int] = field(default_factory=Counter)
    not_finite: int = 0
    outside: float = 0.0
    fall_with_voltage: float = 0.0
    rise_with_thickness: float = 0.0
    single: float = 0.0
    reference: float | None = None
    pull: float = 0.0
    references: int = 0
    branch_missed: int = 0


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


def finger_and_screen(draw: Draw, every_term: bool) -> tuple[Finger, Screen]:
    hurst, rolloff, decades = (
        draw.random.uniform(0.5, 1),
        10 ** draw.random.random(),
        draw("decades"),
    )
    # A spectrum of h_rms 1 m from 1 /m on: its slope says where the wanted slope needs q0.
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
        hardness_pa=modulus * 10 ** draw.random.uniform(-2, 0) if every_term else None,
        roughness=Roughness(
            h_rms_m=h_rms,
            hurst=hurst,
            q0_per_m=q0,
            q_rolloff_per_m=q0 * rolloff,
            q1_per_m=q0 * 10**decades,
        ),
    )
    resistivity = 10 ** draw.random.uniform(4, 9) if every_term else None
    return finger, Screen(max_voltage_v=5000.0, gap_resistivity_ohm_m=resistivity)


def run(job: tuple[int, int]) -> tuple[int, Tally]:
    """Solve one contact of one region."""
    region = REGIONS[job[0]]
    draw = Draw(region, job[1])
    options = dict(region.options)
    every_term = options.pop("every_term", False)
    finger, screen = finger_and_screen(draw, every_term)
    terms = {"finite-size": True, "breakdown": True} if every_term else {"breakdown": True}
    options |= {"gamma": draw("gamma"), "terms": terms}
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
            tally.not_finite += int((~getattr(found, name).isfinite()).sum())
        area = found.area_fraction
        tally.outside = max(tally.outside, float((area - 1).max()), float(-area.min()))
    tally.fall_with_voltage = fall(state, -1)
    tally.rise_with_thickness = rise(plain, 1)
    tally.single = float((narrow.mu.double() / state.mu - 1).abs().max())
    if not set(WITHOUT_REFERENCE) & set(region.options):
        compare(tally, model, (force, voltage, frequency, h0), state)
    return job[0], tally


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


def compare(tally: Tally, model: ContactModel, at: tuple[Any, ...], state: ContactState) -> None:
    """Solve some states that feel their voltage with the slow solver."""
    force, voltage, frequency, h0 = at
    force, h0 = (t.expand_as(voltage) for t in (force, h0))
    lift = state.pressure_pa / (force / model.finger.apparent_area_m2(force))
    # Within 0.97 of the end: closer, an error of I is multiplied by more than ten.
    good = (state.status != int(Status.PULL_IN)) & (voltage < 0.97 * state.pull_in_voltage_v)
    felt = good & (lift > 1.02)
    where = (felt if felt.any() else good).nonzero().tolist()
    chosen = random.Random(str(where)).sample(where, min(REFERENCES, len(where)))
    finger = model.finger
    rough = finger.roughness
    oracle = Oracle(
        SelfAffine(
            float(rough.h_rms_m),
            rough.hurst,
            rough.q0_per_m,
            rough.q_rolloff_per_m,
            rough.q1_per_m,
        ),
        Solid(
            float(finger.youngs_modulus_pa),
            finger.poisson_ratio,
            float(finger.layer_thickness_m),
            float(finger.bulk_modulus_pa),
            finger.bulk_poisson_ratio,
        ),
        model.contact.gamma,
    )
    for place in map(tuple, chosen):
        newton, volt = float(force[place]), float(voltage[place])
        nominal = finger.apparent_area_at_1n_m2 * newton**finger.apparent_area_exponent
        skin = finger.dielectric.relative_permittivity(torch.tensor(frequency, dtype=torch.float64))
        thickness = float(h0[place]) + float(finger.layer_thickness_m) / complex(skin)
        included = model.contact_spots == "included"
        root = oracle.equilibrium(
            newton / nominal, volt, thickness, float(state.pressure_pa[place]), included
        )
        mu = (
            float(finger.frictional_shear_stress_pa) * oracle.area_fraction(root) * nominal / newton
        )
        error = abs(float(state.mu[place]) / mu - 1)
        tally.reference = max(tally.reference or 0.0, error)
        strength = EPS0 * volt**2 / 4
        pull = strength * oracle.gap_pull(float(state.pressure_pa[place]), thickness)
        # In complete contact nothing is left that pulls.
        if pull > 1e-9 * newton / nominal:
            tally.pull = max(tally.pull, abs(float(state.gap_attraction_pa[place]) / pull - 1))
        tally.references += 1
        tally.branch_missed += not oracle.nothing_below(
            newton / nominal, volt, thickness, root, included
        )


def merge(tallies: list[Tally]) -> Tally:
    whole = Tally()
    for one in tallies:
        whole.status.update(one.status)
        for name in ("states", "not_finite", "references", "branch_missed"):
            setattr(whole, name, getattr(whole, name) + getattr(one, name))
        for name in ("outside", "fall_with_voltage", "rise_with_thickness", "single"):
            setattr(whole, name, max(getattr(whole, name), getattr(one, name)))
        if one.reference is not None:
            whole.reference = max(whole.reference or 0.0, one.reference)
            whole.pull = max(whole.pull, one.pull)
    return whole


def quiet(value: float) -> str:
    return "0" if value == 0 else f"{value:.0e}"


def row(name: str, tally: Tally) -> str:
    count = sum(tally.status.values())
    shares = [
        f"{100 * tally.status[int(s)] / count:.0f}"
        for s in (Status.OK, Status.BREAKDOWN, Status.PULL_IN)
    ]
    reference = "-" if tally.reference is None else f"{quiet(tally.reference)} ({tally.references})"
    cells = [
        name,
        f"{tally.states:,}",
        *shares,
        str(tally.not_finite),
        reference,
        "-" if tally.reference is None else quiet(tally.pull),
        quiet(tally.single),
        quiet(tally.outside),
        quiet(tally.fall_with_voltage),
        quiet(tally.rise_with_thickness),
    ]
    return "| " + " | ".join(cells) + " |"


HEAD = """\
# The contact model at its extremes

Random contacts, {contacts} to a region, every number drawn log-uniformly from the region's ranges;
what a region does not name stays in the finger's own surroundings. "Everything at once" draws all
of them at their widest:
{widest}.
Each contact is solved at 4 forces, 4 insulators h0 and one frequency, at voltages drawn from the
region and at 0.3 to 0.999 of each pull-in voltage up to 5 kV, in double and in single precision.

| column | meaning |
|---|---|
{columns}

{table}

mu is off by more than the pull that it comes from: the pull loads the contact that makes it, up to
thirtyfold near the end of the light contact. The reference's own error, by twice its resolution, is
{own_error:.0e} in mu (the paper's finger, 0.5 N, 0.9 of pull-in).
States at which the slow solver found a balance at less pressure than the model did: {missed}.

Made by `python benchmarks/extremes.py` in {seconds:.0f} s:
{machine}.
"""

COLUMNS = {
    "region": "which numbers are drawn from elsewhere",
    "states": "how many were solved",
    "OK": "share of the states with that status, per cent",
    "broken": "share past breakdown of gap or insulator, per cent",
    "pulled in": "share past the end of the light contact, per cent",
    "not finite": "values, in any field of any state, that are NaN or infinite",
    "mu": "largest relative difference of mu from a slow solver that shares no code with the "
    "package (`benchmarks/oracle.py`), and at how many states up to 0.97 of pull-in",
    "pull": "the same of the open gaps' pull at one pressure",
    "single": "largest relative difference of mu between float32 and float64 results",
    "outside": "most by which A/A0 leaves 0 to 1",
    "falls": "largest relative fall of mu as the voltage rises, on the light branch",
    "rises": "largest relative rise of mu as h0 grows, on the light branch",
}


def write(rows: list[str], own_error: float, missed: int, seconds: float) -> None:
    heads = [f"| {' | '.join(COLUMNS)} |", "|" + "---|" * len(COLUMNS)]
    text = HEAD.format(
        contacts=CONTACTS,
        widest=",\n".join(f"{name} {low:g} to {high:g}" for name, (low, high) in WIDEST.items()),
        columns="\n".join(f"| {name} | {meaning} |" for name, meaning in COLUMNS.items()),
        table="\n".join(heads + rows),
        own_error=own_error,
        missed=missed,
        seconds=seconds,
        machine=f"{platform.machine()}, {WORKERS} processes of one thread each, "
        f"Python {platform.python_version()}, torch {torch.__version__.split('+')[0]}",
    )
    REPORT.parent.mkdir(exist_ok=True)
    REPORT.write_text(text, encoding="utf-8")


def own_error() -> float:
    """By how much the slow solver's mu moves at twice its resolution."""
    finger = Finger.preset("semi-wet")
    model = ContactModel(finger, Screen(max_voltage_v=5000.0))
    end = float(model.solve(0.5, 0.0).pull_in_voltage_v)
    state = model.solve(0.5, 0.9 * end)
    nominal = float(finger.apparent_area_m2(torch.tensor(0.5, dtype=torch.float64)))
    rough, solid = SelfAffine(22e-6, 0.86, 1e3, 3992.9, 1e9), Solid(40e6, 0.5, 200e-6, 10e3)
    roots = [
        Oracle(rough, solid, 0.45, fineness).equilibrium(
            0.5 / nominal, 0.9 * end, complex(model.screen.h0_m), float(state.pressure_pa)
        )
        for fineness in (1.0, 2.0)
    ]
    return abs(roots[0] / roots[1] - 1)


def one_thread() -> None:
    torch.set_num_threads(1)


def main() -> None:
    began = time.perf_counter()
    jobs = [(r, number) for r in range(len(REGIONS)) for number in range(CONTACTS)]
    found: dict[int, list[Tally]] = {}
    rows, missed = [], 0
    # Forked processes would inherit torch's threads in an unusable state.
    with ProcessPoolExecutor(WORKERS, get_context("spawn"), one_thread) as pool:
        for index, tally in pool.map(run, jobs):
            found.setdefault(index, []).append(tally)
            if len(found[index]) == CONTACTS:
                whole = merge(found[index])
                missed += whole.branch_missed
                rows.append(row(REGIONS[index].name, whole))
                print(f"{time.perf_counter() - began:5.0f} s  {rows[-1]}", flush=True)
    one_thread()
    write(rows, own_error(), missed, time.perf_counter() - began)
    print(f"wrote {REPORT.parent.name}/{REPORT.name}")


if __name__ == "__main__":
    main()
