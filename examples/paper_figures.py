"""The paper's figures, and those of roughness and gaps, as drawings and numbers.

    python examples/paper_figures.py [2d 3b 3c 3d 4 roughness gaps] [--out FOLDER]

Writes a PNG, with its caption, and a CSV for each. A cell is empty where the light contact has
snapped in, and the column of its status (`haptix.Status`) says so. The circles of 2D are solved by
benchmarks/figure_2d.py.
"""

import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
import torch
import typer
from torch import Tensor

import haptix
from haptix import ContactModel, Finger, Screen, Status
from haptix.base.files import csv_text
from haptix.model import (
    THEORIES,
    Contact,
    GapDistribution,
    HalfSpace,
    Load,
    MeanFieldBalance,
    Pull,
    RoughnessSpectrum,
    SkinDielectric,
    Theory,
)
from haptix.model.electro.breakdown import NARROW_GAP_FIELD_V_PER_M
from haptix.model.finger import Roughness

try:
    import matplotlib
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine
    from matplotlib.ticker import EngFormatter, NullFormatter
except ModuleNotFoundError as error:
    sys.exit(f"needs {error.name}; run: pip install 'haptix-electrovibration[figures]'")

Array = npt.NDArray[np.float64]

H0_M = 0.2e-6  # d1/eps1 + d2/eps2 of the paper at 125 Hz, for figures at one frequency
AT_H0 = {"skin-dielectric": False, "breakdown": True}  # the skin is in the h0 that is given
AS_QUERIED = (
    "`haptix query --h0-m 2e-7 --with breakdown` gives the same friction at the mean attraction."
)
COLD_TO_HOT = ("#4477aa", "#66a9c9", "#228833", "#ccaa22", "#ee6677", "#882255")  # after P. Tol
NARROW_GAPS_BEAR = f"the {NARROW_GAP_FIELD_V_PER_M / 1e6:g} V/µm that narrow gaps withstand"
VOLTAGES_V = (0.0, 50.0, 100.0, 150.0, 200.0)


@dataclass(frozen=True)
class PaperFigure:
    """Columns of numbers, a caption, and the function that draws the columns."""

    name: str
    title: str
    caption: str
    columns: Mapping[str, Array]  # by name with unit, each of shape (rows,)
    plot: Callable[..., None]  # draws on the axes of the panels, which are its arguments
    grid: tuple[int, int] = (1, 1)  # rows and columns of panels; rows share their x axis
    legend_title: str = ""


def numbers(values: Tensor) -> Array:
    """Values of a tensor as a column."""
    return np.asarray(values.cpu(), dtype=float)


def light_contact(values: Tensor, status: Tensor) -> Array:
    """Values as a column, NaN where the contact has snapped in and no light one exists."""
    return np.where(numbers(status) == Status.PULL_IN, np.nan, numbers(values))


def sentence_list(words: list[str]) -> str:
    """Join words as in a sentence: "a, b and c"."""
    return " and ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


def placeholders(model: ContactModel) -> str:
    """Sentence for a caption: the unmeasured values."""
    found = model.placeholders()
    if not found:
        return "No placeholders: all values are measured."
    return f"Placeholders, not measured: {sentence_list(found)}."


def basis(model: ContactModel, also_on: str = "") -> str:
    """Return sentences for a caption: the assumptions behind a model's numbers.

    `also_on` names terms that are on for some of the curves only, and for which.
    """
    on = ", ".join(filter(None, [*sorted(model.terms), also_on]))
    return (
        f"{placeholders(model)} Terms on: {on}. Contact spots in the attraction: "
        f"{model.contact_spots}; gap distribution {model.contact.gap_distribution}, gamma "
        f"{model.contact.gamma:g}."
    )


# Width and height of the panels and their legend, by rows and columns of panels.
SIZE_IN = {(1, 1): (6.9, 3.7), (1, 2): (10.4, 3.7), (2, 1): (7.2, 4.6)}
CAPTION_POINTS = 8.0
LINE_IN = 1.35 * CAPTION_POINTS / 72
LETTERS_PER_IN = 16.3  # of the caption's font, on average

TOGETHER = re.compile(r"(?<= =) | (?==)|(?<=\d) (?=[NVµkM]|Hz|Ohm)")  # spaces not to break at

STYLE: dict[Any, Any] = {
    "font.size": 10.5,
    "axes.labelsize": 11.5,
    "legend.fontsize": 9.5,
    "legend.title_fontsize": 9.5,
    "axes.linewidth": 0.9,
    "lines.linewidth": 1.8,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.top": True,
    "ytick.right": True,
}


def mark(axes: Axes, x: float, y: float, shape: str, label: str, color: str) -> None:
    """Draw one point of note; points with one label share their line in the legend."""
    hollow = shape == "o"
    axes.plot(
        x, y, shape, ms=6, mfc="white" if hollow else color, mec=color,
        mew=1.4 if hollow else 0.6, clip_on=False, zorder=4,
    )  # fmt: skip
    if label not in axes.get_legend_handles_labels()[1]:
        face = "white" if hollow else "0.3"
        axes.plot([], [], shape, ms=6, mfc=face, mec="0.3", mew=1.2, label=label)


def draw(data: PaperFigure) -> Figure:
    """Return the drawing of a figure."""
    width, height = SIZE_IN[data.grid]
    lines = wrap(
        TOGETHER.sub("\N{NO-BREAK SPACE}", data.caption),
        round(width * LETTERS_PER_IN),
        break_on_hyphens=False,
    )
    below = LINE_IN * (len(lines) + 1)
    share = height / (height + below)
    with matplotlib.rc_context(STYLE):
        layout = ConstrainedLayoutEngine(rect=(0, 1 - share, 1, share))
        figure = Figure(figsize=(width, height + below), layout=layout)
        axes = figure.subplots(*data.grid, squeeze=False, sharex="col").ravel()
        data.plot(*axes)
        for one in axes:
            one.xaxis.set_minor_formatter(NullFormatter())
            one.yaxis.set_minor_formatter(NullFormatter())
        axes[-1].legend(
            loc="upper left",
            bbox_to_anchor=(1.01, 1.02),  # beside the axes, where it hides nothing
            title=data.legend_title or None,
            frameon=False,
            alignment="left",
            handlelength=1.8,
        )
        figure.text(
            0.1 / width,
            (below - 0.5 * LINE_IN) / (height + below),
            "\n".join(lines),
            ha="left",
            va="top",
            fontsize=CAPTION_POINTS,
            linespacing=1.15,
            color="0.2",
        )
    return figure


# What 512 x 512 points can hold with eight of them per shortest wavelength: 1 um of roughness on
# skin of 40 MPa, not a whole finger.
SPECTRUM = RoughnessSpectrum.self_affine(1e-6, 0.8, 22.5e3, 90e3, 1.44e6)
SKIN = HalfSpace(40e6, 0.5)
PRESSURES_PA = (3e3, 1e4, 3e4, 1e5, 3e5, 1e6)

BOUNDARY_ELEMENTS = Path(__file__).with_name("paper_figures_2d.csv")
THEORY_STYLES = {"as-published": "--", "local": "-"}
LINE_PRESSURES_PA = np.geomspace(2e3, 1.5e6, 121)


def area_against_pressure() -> PaperFigure:
    """A/A0 against p0 from 2 kPa to 1.5 MPa at 0 to 200 V: two theories, boundary elements."""
    table = np.loadtxt(BOUNDARY_ELEMENTS, delimiter=",", skiprows=1)
    solved = {(p, voltage): (area, scatter) for p, voltage, _, area, scatter in table}
    columns: dict[str, Array] = {"pressure_pa": np.concatenate([LINE_PRESSURES_PA, PRESSURES_PA])}
    no_line = np.full_like(LINE_PRESSURES_PA, np.nan)
    no_points = np.full(len(PRESSURES_PA), np.nan)
    for voltage in VOLTAGES_V:
        for name in THEORY_STYLES:
            area = area_fraction(THEORIES[name], voltage)
            columns[f"area_fraction_{name}_{voltage:g}v"] = np.concatenate([area, no_points])
        points = np.array([solved.get((p, voltage), (np.nan, np.nan)) for p in PRESSURES_PA])
        column = f"area_fraction_boundary_elements_{voltage:g}v"
        columns[column] = np.concatenate([no_line, points[:, 0]])
        columns[f"{column}_scatter"] = np.concatenate([no_line, points[:, 1]])

    def plot(axes: Axes) -> None:
        pressure = columns["pressure_pa"]
        for voltage, color in zip(VOLTAGES_V, COLD_TO_HOT, strict=False):
            for name, style in THEORY_STYLES.items():
                area = columns[f"area_fraction_{name}_{voltage:g}v"]
                label = f"{voltage:g} V" if name == "local" else None
                axes.plot(pressure, area, style, color=color, label=label)
            column = f"area_fraction_boundary_elements_{voltage:g}v"
            axes.errorbar(
                pressure, columns[column], columns[f"{column}_scatter"], fmt="o", color=color,
                ms=4, elinewidth=1.5, capsize=2, zorder=4,
            )  # fmt: skip
        for name, style in THEORY_STYLES.items():
            axes.plot([], [], style, color="0.35", label=name.replace("-", " "))
        axes.errorbar([], [], [], fmt="o", color="0.35", ms=4, label="boundary\nelements")
        axes.set(xlabel="applied pressure $p_\\mathrm{0}$ (Pa)", ylabel="$A/A_\\mathrm{0}$")
        axes.set(xscale="log", yscale="log", xlim=(2e3, 1.5e6))

    return PaperFigure(
        name="fig2d",
        title="Contact area against pressure, by theory and by boundary elements",
        caption=(
            "Real over apparent contact area against applied pressure p0 at voltages of 0 to 200 V "
            f"and h0 = {H0_M * 1e6:g} µm. Circles: boundary elements, the attraction acting on "
            "every point, mean and standard deviation over random surfaces "
            "(benchmarks/figure_2d.py). Dashed: the mean field as published, whose contact spots "
            "attract too; solid: local, as all else uses it (docs/mean-field.md). A line ends "
            f"where its light contact does. Placeholder of a finger: half-space of "
            f"40 MPa, {SPECTRUM.statement()}, which is what the grid can hold."
        ),
        columns=columns,
        plot=plot,
    )


def area_fraction(theory: Theory, voltage_v: float) -> Array:
    contact = theory.mean_field(SPECTRUM, SKIN)
    applied = torch.from_numpy(LINE_PRESSURES_PA)
    solver = MeanFieldBalance(Contact(contact, theory.contact_spots, None, float(applied[0])))
    pull = Pull.of_sine(
        contact.gap_edges_m,
        torch.full_like(applied, voltage_v),
        torch.tensor([H0_M], dtype=torch.float64),
        torch.zeros(len(applied), dtype=torch.long),
    )
    found = solver.solve(Load(applied, pull))
    return np.where(found.is_stable.numpy(), found.area_fraction.numpy(), np.nan)


def friction_in_time() -> PaperFigure:
    """Friction force at 1 N, under 200 V at 125 Hz and without voltage, over 40 ms."""
    force_n, voltage_v, frequency_hz, shown_s = 1.0, 200.0, 125.0, 0.04
    samples = 256  # in a period; the ripple is smooth
    finger, screen = Finger.preset("semi-wet"), Screen.preset("3m-sct3250")
    model = ContactModel(finger, screen, terms=AT_H0)
    period = model.over_period(force_n, voltage_v, frequency_hz, h0_m=H0_M, samples=samples)
    periods = round(shown_s * frequency_hz)
    time = np.arange(periods * samples) / (samples * frequency_hz)
    friction = np.tile(force_n * light_contact(period.mu, period.status), periods)
    averaged = model.solve(force_n, voltage_v, frequency_hz, H0_M)
    off_n = force_n * float(model.solve(force_n, 0.0, frequency_hz, H0_M).mu)
    columns = {
        "time_ms": time * 1e3,
        "drive_v": np.tile(numbers(period.drive_v), periods),
        "attraction_pa": np.tile(light_contact(period.attraction_pa, period.status), periods),
        "friction_200v_n": friction,
        "friction_0v_n": np.full_like(time, off_n),
        "status_200v": np.tile(numbers(period.status), periods),
    }

    def plot(above: Axes, below: Axes) -> None:
        above.plot(columns["time_ms"], columns["drive_v"], color="0.35", lw=1.4)
        above.set(ylabel="voltage (V)")
        for column, label, color in (
            ("friction_200v_n", "200 V, 125 Hz", COLD_TO_HOT[2]),
            ("friction_0v_n", "voltage off", COLD_TO_HOT[0]),
        ):
            below.plot(columns["time_ms"], columns[column], color=color, label=label)
        below.set(xlabel="time (ms)", xlim=(0, shown_s * 1e3))
        below.set(ylabel=r"friction force $F_\mathrm{f}$ (N)", ylim=(0, 1.1 * friction.max()))

    caption = (
        f"Friction force at a normal force of {force_n:g} N, with {voltage_v:g} V at "
        f"{frequency_hz:g} Hz on the screen and with the voltage off; h0 = "
        f"{H0_M * 1e6:g} µm, as in Fig. 3C. Attraction depends on the "
        f"square of the voltage, so that friction ripples at {2 * frequency_hz:g} Hz: from "
        f"{friction.min():.3f} to {friction.max():.3f} N, mean {friction.mean():.3f} N; without "
        f"voltage {off_n:.3f} N. The contact follows the attraction without delay, and the skin's "
        "inertia and viscosity are left out; in equilibrium with the time-averaged attraction it "
        f"is {force_n * float(averaged.mu):.3f} N. The field at the edges of contact spots peaks "
        f"at {float(averaged.peak_field_v_per_m) / 1e6:.0f} V/µm, against {NARROW_GAPS_BEAR}; "
        f"the curve holds without sparks. {AS_QUERIED} {basis(model)}"
    )
    title = "Friction against time under a sine"
    return PaperFigure("fig3b", title, caption, columns, plot, grid=(2, 1))


def friction_against_force() -> PaperFigure:
    """Friction coefficient against F_N from 0.1 to 1 N, V0 from 0 to 200 V, at h0 = 0.2 um."""
    forces_n = np.linspace(0.1, 1.0, 361)
    finger, screen = Finger.preset("semi-wet"), Screen.preset("3m-sct3250")
    models = (
        ContactModel(finger, screen, terms=AT_H0),
        ContactModel(finger, screen, terms={**AT_H0, "finite-size": True}, theory="as-published"),
    )
    force, voltage = torch.from_numpy(forces_n)[:, None], torch.tensor(VOLTAGES_V)
    columns = {"normal_force_n": forces_n}
    curves = []
    for form, model in zip(("mu", "mu_as_published"), models, strict=True):
        states = model.solve(force, voltage, h0_m=H0_M)
        mu = light_contact(states.mu, states.status)
        curves.append(mu)
        status = numbers(states.status)
        for k, v in enumerate(VOLTAGES_V):
            columns[f"{form}_{v:g}v"] = mu[:, k]
            columns[f"{form.replace('mu', 'status')}_{v:g}v"] = status[:, k]

    def plot(axes: Axes) -> None:
        usual, published = curves
        for k, (v, color) in enumerate(zip(VOLTAGES_V, COLD_TO_HOT, strict=False)):
            axes.plot(forces_n, usual[:, k], color=color, label=f"{v:g} V")
            axes.plot(forces_n, published[:, k], "--", color=color, lw=0.9, zorder=1.9)
        axes.plot([], [], "--", color="0.35", lw=0.9, label="as published")
        axes.set(xlabel=r"normal force $F_\mathrm{N}$ (N)", ylabel=r"friction coefficient $\mu$")
        axes.set(xlim=(0.0, 1.02))
        axes.set(ylim=(0.85 * np.nanmin(curves), 1.04 * np.nanmax(curves)))

    caption = (
        "Friction coefficient against normal force for voltage amplitudes of 0 to 200 V at "
        f"h0 = {H0_M * 1e6:g} µm; E = {float(finger.youngs_modulus_pa) / 1e6:g} MPa, "
        f"d = {float(finger.layer_thickness_m) * 1e6:g} µm, "
        f"E_bulk = {float(finger.bulk_modulus_pa or 0.0) / 1e3:g} kPa. Solid: the usual model; "
        f"{AS_QUERIED} Dashed: the theory as published, whose contact spots attract too, with "
        "its limit of finite size, h_rms sqrt(2 ln N): its gaps stop widening there, with a kink. "
        "Both have one friction without voltage at the paper's load. The field at the edges of "
        f"contact spots is V0/h0: it passes {NARROW_GAPS_BEAR} at "
        f"{NARROW_GAP_FIELD_V_PER_M * H0_M:.0f} V; beyond, the curves hold without sparks. "
        + basis(models[0])
    )
    title, legend = "Friction coefficient against normal force", "amplitude $V_\\mathrm{0}$"
    return PaperFigure("fig3c", title, caption, columns, plot, legend_title=legend)


def area_against_voltage() -> PaperFigure:
    """A/A0 against V0 from 0 to 200 V at p0 = 10 kPa and E = 100 MPa."""
    h0_um, pressure_pa, modulus_pa = (0.03, 0.05, 0.1, 0.2, 0.5, 1.0), 10e3, 100e6
    voltages_v = np.linspace(0.0, 200.0, 401)
    finger = Finger.preset("semi-wet").replace(
        youngs_modulus_pa=modulus_pa,
        apparent_area_at_1n_m2=1.0 / pressure_pa,  # so that 1 N presses with p0
        apparent_area_exponent=0.0,
    )
    terms = {"skin-dielectric": False, "breakdown": True}
    model = ContactModel(finger, Screen.preset("3m-sct3250"), terms=terms)
    h0 = torch.tensor(h0_um, dtype=torch.float64) * 1e-6
    pull_in = numbers(model.solve(1.0, 0.0, h0_m=h0).pull_in_voltage_v)
    reached = pull_in < voltages_v[-1]
    # Just before pull-in the contact is still light: the curve's last point.
    voltage = np.unique(np.concatenate([voltages_v, (1 - 1e-6) * pull_in[reached]]))
    states = model.solve(1.0, torch.from_numpy(voltage)[:, None], h0_m=h0)
    columns = {"voltage_v": voltage}
    marks: list[tuple[int, int, str, str]] = []  # insulator, row, shape, label
    for k, thickness in enumerate(h0_um):
        name = f"h0_{thickness:g}um"
        area = light_contact(states.area_fraction[:, k], states.status[:, k])
        increase = 100 * (area / area[0] - 1)
        columns[f"area_fraction_{name}"] = area
        columns[f"increase_percent_{name}"] = np.where(voltage > 0, increase, np.nan)
        status = columns[f"status_{name}"] = numbers(states.status[:, k])
        if (broken := np.flatnonzero(status == Status.BREAKDOWN)).size:
            marks.append((k, int(broken[0]), "o", "gap field passes\n350 V/µm"))
        if reached[k]:
            marks.append((k, int(np.flatnonzero(~np.isnan(area))[-1]), "X", "pull-in"))

    def plot(left: Axes, right: Axes) -> None:
        for axes, quantity in ((left, "area_fraction"), (right, "increase_percent")):
            drawn = [columns[f"{quantity}_h0_{thickness:g}um"] for thickness in h0_um]
            for y, thickness, color in zip(drawn, h0_um, reversed(COLD_TO_HOT), strict=True):
                axes.plot(voltage, y, color=color, label=f"{thickness:g} µm")
            for k, row, shape, label in marks:
                mark(axes, voltage[row], drawn[k][row], shape, label, COLD_TO_HOT[-1 - k])
            axes.set(xlabel="voltage amplitude $V_\\mathrm{0}$ (V)", xlim=(0, 200), yscale="log")
        areas = np.stack([columns[f"area_fraction_h0_{thickness:g}um"] for thickness in h0_um])
        lowest = 10 ** np.floor(np.log10(np.nanmin(areas)))
        left.set(ylabel="$A/A_\\mathrm{0}$", ylim=(lowest, 1.5 * np.nanmax(areas)))
        right.set(ylabel="increase of $A/A_\\mathrm{0}$ (%)", ylim=(1e-2, 5e3))

    snapped = [f"{pull_in[k]:.0f} V for {h0_um[k]:g} µm" for k in np.flatnonzero(reached)]
    caption = (
        "Left: real over apparent contact area against voltage amplitude for several effective "
        f"thicknesses h0 of the insulator, at p0 = {pressure_pa / 1e3:g} kPa and "
        f"E = {modulus_pa / 1e6:g} MPa. Right: its increase over the area without voltage. "
        f"Crosses: the light contact snaps in at {sentence_list(snapped)}; nothing is drawn "
        "beyond. Circles: from here on the field V0/h0 at the edges of contact spots is above "
        f"{NARROW_GAPS_BEAR}, and the curve holds without sparks only. {basis(model)}"
    )
    title = "Contact area against voltage and insulator thickness"
    return PaperFigure("fig3d", title, caption, columns, plot, (1, 2), r"$h_\mathrm{0}$")


def area_against_frequency() -> PaperFigure:
    """A_on/A_off against f from 1 Hz to 1 MHz at 0.5 N and 100 V, d1 = 1 um, eps1 = 8."""
    force_n, voltage_v, frequency_hz = 0.5, 100.0, np.geomspace(1.0, 1e6, 361)
    gaps = {"dry_gap": None} | {f"leaky_gap_1e{n}_ohm_m": 10.0**n for n in (7, 6, 5)}
    colors = (COLD_TO_HOT[0], COLD_TO_HOT[2], COLD_TO_HOT[3], COLD_TO_HOT[4])
    finger = Finger.preset("semi-wet")
    frequency = torch.from_numpy(frequency_hz)
    columns = {"frequency_hz": frequency_hz}
    models, ratios, tops = {}, {}, {}
    for name, resistivity in gaps.items():
        screen = Screen(
            name="Fig. 4",
            insulator_thickness_m=1e-6,
            insulator_permittivity=8.0,
            gap_resistivity_ohm_m=resistivity,
        )
        model = models[name] = ContactModel(finger, screen, terms={"breakdown": True})
        on = model.solve(force_n, voltage_v, frequency)
        off = model.solve(force_n, 0.0, frequency)
        ratios[name] = light_contact(on.area_fraction / off.area_fraction, on.status)
        columns[f"area_on_over_off_{name}"] = ratios[name]
        columns[f"status_{name}"] = numbers(on.status)
        if resistivity is not None:
            tops[name] = int(np.nanargmax(ratios[name]))

    def plot(axes: Axes) -> None:
        for (name, resistivity), color in zip(gaps.items(), colors, strict=True):
            label = "no leakage"
            if resistivity is not None:
                label = rf"$\mathrm{{10}}^{np.log10(resistivity):.0f}$ Ωm"
            axes.plot(frequency_hz, ratios[name], color=color, label=label)
        for (name, top), color in zip(tops.items(), colors[1:], strict=True):
            mark(axes, float(frequency_hz[top]), ratios[name][top], "o", "maximum", color)
        axes.set(xlabel="frequency $f$ (Hz)", xscale="log", xlim=frequency_hz[[0, -1]])
        axes.set(ylabel=r"$A_\mathrm{on}/A_\mathrm{off}$")

    dry = ratios["dry_gap"]
    highest = [
        f"{ratios[n][top]:.3f} at {with_unit(float(frequency_hz[top]))}" for n, top in tops.items()
    ]
    broken = frequency_hz[columns["status_dry_gap"] == Status.BREAKDOWN]
    assert isinstance(finger.dielectric, SkinDielectric)  # that of the presets
    table = finger.dielectric.frequency_hz
    caption = (
        "Real contact area with voltage over that without, against the frequency of the drive, at "
        f"F_N = {force_n:g} N and V0 = {voltage_v:g} V; d1 = 1 µm, eps1 = 8, "
        f"d2 = {float(finger.layer_thickness_m) * 1e6:g} µm. Without leakage the ratio is largest "
        f"at low frequencies, {dry[0]:.3f} at {frequency_hz[0]:g} Hz, where the skin conducts. A "
        "gap of finite resistivity lets the charge across at low frequencies, and a maximum "
        f"appears: {sentence_list(highest)} for 1e7, 1e6 and 1e5 Ohm m. "
        f"Up to {with_unit(broken[-1])} the field in the dry gap passes {NARROW_GAPS_BEAR}, "
        "and its curve holds without sparks. The table of the skin's dielectric reaches from "
        f"{with_unit(table[0])} to {with_unit(table[-1])} and is held at its last values beyond. "
        f"{basis(models['dry_gap'], also_on='leaky-gap for the gaps that leak')}"
    )
    title, legend = "Contact area against frequency", "resistivity of the gap"
    return PaperFigure("fig4", title, caption, columns, plot, legend_title=legend)


def with_unit(frequency_hz: float) -> str:
    return EngFormatter("Hz")(float(f"{frequency_hz:.2g}"))


OTHER_ROUGHNESSES = (  # those of the physics page, section 3
    Roughness(q1_per_m=1e8, q_rolloff_per_m=5981.5),
    Roughness(q1_per_m=1e7, q_rolloff_per_m=9142.0),
)


def roughness_spectra(finger: Finger | None = None) -> PaperFigure:
    """C(q) and the rms slope of the waves up to q, for a finger and two placeholders.

    The finger is the semi-wet one unless another is given.
    """
    finger = finger or Finger.preset("semi-wet")
    names = ("finger", *(f"placeholder_q1_1e{np.log10(p.q1_per_m):.0f}" for p in OTHER_ROUGHNESSES))
    roughnesses = (finger.roughness, *OTHER_ROUGHNESSES)
    spectra = {n: r.spectrum() for n, r in zip(names, roughnesses, strict=True)}
    wavenumber = wavenumbers(list(spectra.values()))
    columns = {"wavenumber_per_m": wavenumber}
    for name, spectrum in spectra.items():
        inside = (wavenumber >= spectrum.q0) & (wavenumber <= spectrum.q1)
        q = torch.from_numpy(wavenumber[inside])
        rest = spectrum.moment(3) - spectrum.moment(3, q)
        for column, values in (
            (f"c_{name}_m4", spectrum(q)),
            (f"rms_slope_up_to_q_{name}", rest.clamp(min=0.0).sqrt()),
        ):
            columns[column] = np.full_like(wavenumber, np.nan)
            columns[column][inside] = numbers(values)

    def plot(left: Axes, right: Axes) -> None:
        for (name, spectrum), color in zip(
            spectra.items(), ("black", COLD_TO_HOT[0], COLD_TO_HOT[4]), strict=True
        ):
            which, style, width = "other", "--", 1.6
            if name == "finger":
                which, style, width = finger.name, "-", 2.2
            label = (
                f"{which}: $q_\\mathrm{{r}}$ = {spectrum.q_rolloff:.0f} /m,\n"
                f"$q_\\mathrm{{1}}$ = $\\mathrm{{10}}^{{{np.log10(spectrum.q1):.3g}}}$ /m"
            )
            for axes, column in ((left, f"c_{name}_m4"), (right, f"rms_slope_up_to_q_{name}")):
                axes.plot(wavenumber, columns[column], style, color=color, lw=width,
                          zorder=2 + width / 10, label=label)  # fmt: skip
        for axes in (left, right):
            axes.set(xlabel="wavenumber $q$ (1/m)", xscale="log")
            axes.set_xlim(wavenumber[0] / 2, wavenumber[-1] * 2)
        left.set(ylabel="$C(q)$ (m$^4$)", yscale="log")
        right.set(ylabel="rms slope up to $q$", ylim=(0, 1))

    shown = spectra["finger"]
    measured = (
        "Placeholders, not measured: all three spectra; the measured one is printed as a "
        "figure only."
        if finger.roughness.is_placeholder
        else "The two others are placeholders, the finger's own is measured."
    )
    caption = (
        f"Left: roughness power spectrum of the {finger.name} finger (black) and of two others "
        f"that have the same root-mean-square height ({float(shown.h_rms_m) * 1e6:.4g} µm), "
        f"slope ({float(shown.slope_rms):.2f}) and Hurst exponent ({OTHER_ROUGHNESSES[0].hurst:g}) "
        "within rounding, but end at other wavenumbers q1. Right: root-mean-square slope of the "
        f"waves longer than 2π/q. Convention: h_rms² = 2π ∫ q C dq. {measured} No contact is "
        "solved here, so that neither its terms nor contact spots enter."
    )
    title = "Roughness of the finger and of two placeholders"
    return PaperFigure("roughness", title, caption, columns, plot, (1, 2), "spectrum")


def wavenumbers(spectra: list[RoughnessSpectrum]) -> Array:
    """60 wavenumbers per decade, with the bends of every spectrum among them."""
    low, high = min(s.q0 for s in spectra), max(s.q1 for s in spectra)
    even = np.geomspace(low, high, round(60 * np.log10(high / low)) + 1)
    bends = np.concatenate([numbers(s.wavenumber) for s in spectra])
    # Bends take the place of neighbours that differ by rounding only.
    apart = np.abs(even[:, None] / bends - 1).min(axis=1) > 1e-9
    return np.unique(np.concatenate([even[apart], bends]))


def gap_distributions(finger: Finger | None = None) -> PaperFigure:
    """P(u) of the open gaps, "plain" and "combined", at a few effective pressures.

    The finger is the semi-wet one unless another is given.
    """
    # The paper's range of nominal pressure, and what an attraction near pull-in makes of it.
    pressures_pa, gap_m = (3e3, 20e3, 200e3), np.geomspace(1e-10, 3e-4, 400)
    forms: dict[GapDistribution, str] = {"plain": "-", "combined": "--"}
    colors = (COLD_TO_HOT[0], COLD_TO_HOT[2], COLD_TO_HOT[4])
    finger = finger or Finger.preset("semi-wet")
    screen = Screen.preset("3m-sct3250")
    terms = {"skin-dielectric": False, "apparent-area": False}  # pressure is given, not force
    pressure = torch.tensor(pressures_pa, dtype=torch.float64)[:, None]
    columns = {"gap_um": gap_m * 1e6}
    densities = []
    models = [ContactModel(finger, screen, gap_distribution=f, terms=terms) for f in forms]
    for form, model in zip(forms, models, strict=True):
        density = numbers(model.contact.gap_density(pressure, torch.from_numpy(gap_m))) * 1e-6
        densities.append(density)
        for row, pressure_pa in zip(density, pressures_pa, strict=True):
            columns[f"density_{form}_{pressure_pa / 1e3:g}kpa_per_um"] = row

    def plot(axes: Axes) -> None:
        for (form, style), density in zip(forms.items(), densities, strict=True):
            for row, pressure_pa, color in zip(density, pressures_pa, colors, strict=True):
                label = f"{pressure_pa / 1e3:g} kPa, {form}"
                axes.plot(columns["gap_um"], row, style, color=color, label=label)
        axes.set(xlabel="gap $u$ (µm)", xscale="log", xlim=(1e-4, 300))
        axes.set(ylabel="$P(u)$ (1/µm)", yscale="log", ylim=(1e-5, 10))

    between = (gap_m >= 1e-9) & (gap_m <= 1e-5)
    plain, combined = (density[:, between] for density in densities)
    apart = float(np.abs(combined / plain - 1).max())
    model = models[-1]
    caption = (
        "Probability density of the gap u between finger and screen at effective pressures of "
        f"{', '.join(f'{p / 1e3:g}' for p in pressures_pa)} kPa, contact spots excluded: each "
        "curve integrates to 1 - A/A0. Solid: plain, each strip of area has the variance of the "
        "shorter waves (Almqvist et al. 2011); dashed: combined with the strip's own mean gap "
        "(later papers). Nothing is drawn below 0.1 nm, less than an atom, where a gap has no "
        f"sense. From 1 nm to 10 µm they differ by at most {apart:.0%}. Below 1e-5 per "
        "µm the far tail shows the single strips into which the contact is divided. "
        f"{placeholders(model)} Terms on: {', '.join(sorted(model.terms))}; gamma "
        f"{model.contact.gamma:g}."
    )
    title, legend = "Distribution of the gap between finger and screen", "pressure, form"
    return PaperFigure("gaps", title, caption, columns, plot, legend_title=legend)


FIGURES: Mapping[str, Callable[[], PaperFigure]] = {
    "2d": area_against_pressure,
    "3b": friction_in_time,
    "3c": friction_against_force,
    "3d": area_against_voltage,
    "4": area_against_frequency,
    "roughness": roughness_spectra,
    "gaps": gap_distributions,
}


def write(figure: PaperFigure, folder: Path) -> None:
    """Write NAME.png, which carries title and caption, and NAME.csv, an empty cell for a NaN."""
    rows = zip(*figure.columns.values(), strict=True)
    cells = ([None if np.isnan(value) else value for value in row] for row in rows)
    (folder / f"{figure.name}.csv").write_text(
        csv_text(figure.columns, cells, 10), encoding="utf-8"
    )
    metadata = {"Title": figure.title, "Description": figure.caption}
    with matplotlib.rc_context(STYLE):
        draw(figure).savefig(folder / f"{figure.name}.png", dpi=200, metadata=metadata)


def main(
    names: Annotated[list[str] | None, typer.Argument(help="Figures; by default all.")] = None,
    out: Annotated[Path, typer.Option(help="Folder for the files.")] = Path("paper-figures"),
) -> None:
    """Draw the paper's figures, and those of roughness and gaps, from the model."""
    for name in names or FIGURES:
        if name not in FIGURES:
            raise haptix.InputError(
                f"unknown figure {name!r}; expected any of {', '.join(FIGURES)}"
            )
    out.mkdir(parents=True, exist_ok=True)
    for name in names or FIGURES:
        figure = FIGURES[name]()
        write(figure, out)
        print(f"{out / figure.name}.png, .csv: {figure.title}")


if __name__ == "__main__":
    try:
        typer.run(main)
    except (haptix.HaptixError, OSError) as error:
        sys.exit(f"paper_figures: {error}")
