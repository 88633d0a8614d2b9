"""The documents of a calibration: its report, an HTML page, and its certificate, a PDF.

The page has its pictures inside and needs no network. The certificate is one page with an appendix
of its evidence.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, date, datetime
from html import escape
from io import BytesIO
from itertools import cycle
from math import floor, log10
from pathlib import Path
from textwrap import wrap

import numpy as np
from pydantic import Field
from scipy.stats import t as student

from calibration.fit.result import Fit, TermNeed
from calibration.keep.gauge import ControlChart
from calibration.measure.recording import StrokeRecording
from calibration.measure.reduction import Point, Reduced
from calibration.measure.rig import RigCheck
from calibration.measure.segmentation import full_slip
from calibration.measure.session import Instruments
from calibration.plan.parameters import Array
from calibration.plan.predict import StrokeConditions, StrokePredictor
from calibration.plan.protocol import FORCES_N
from calibration.verify.budget import FORCE_N, SPEED_MM_PER_S, Budget
from calibration.verify.verification import Verification
from haptix.base.documents import Document
from haptix.base.errors import InputError, from_extra
from haptix.base.files import read_text, write_whole
from haptix.base.report import listed, page, paragraph, part, picture, row
from haptix.base.version import __version__
from haptix.model.finger import Finger
from haptix.model.pair import described
from haptix.model.perception.thresholds import WEBER_FRACTION
from haptix.model.screen import Screen

with from_extra("calibration"):
    from matplotlib import rc_context
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_pdf import PdfPages
    from matplotlib.figure import Figure

_WIDTH, _HEIGHT = 900, 190
_COLUMNS = 300  # each with the lowest and the highest sample in it
_TRACES = {"normal force [N]": "#1f5fa8", "tangential force [N]": "#c9541c", "x": "#a6761d"}
_COLOURS = ("#3b4cc0", "#7b9ff9", "#8a8a8a", "#f4987a", "#b40426", "#1b9e77", "#7570b3", "#a6761d")


def write_report(
    path: str | Path,
    screen: Screen,
    fit: Fit,
    reduced: Reduced,
    verification: Verification,
    predictor: StrokePredictor,
    needs: Sequence[TermNeed] = (),
    profile_is_written: bool = True,
    recordings: Sequence[StrokeRecording] = (),
) -> None:
    """Write the page, or raise `FileFormatError`.

    Parameters
    ----------
    path : str or Path
    screen : Screen
        As calibrated; as it was assumed where the insulator is not determined.
    fit : Fit
        The fit.
    reduced : Reduced
        The reduced strokes.
    verification : Verification
        The verdict.
    predictor : StrokePredictor
        The model of the fit.
    needs : sequence of TermNeed
        Which terms the strokes show.
    profile_is_written : bool
        Whether there is a profile beside it.
    recordings : sequence of StrokeRecording
        The strokes, whose raw traces are shown.
    """
    calibration, verdict = screen.calibration, verification.verdict
    about, rests_on = "", tuple[str, ...]()
    if calibration is not None:
        about = (
            f"{calibration.date}, operator {calibration.operator or 'not named'}, "
            f"{', '.join(calibration.instruments) or 'no instruments named'}"
        )
        rests_on = calibration.rests_on
    minutes = minutes_of(recordings)
    parts = [
        paragraph(about),
        "" if profile_is_written else "<p class=failed>No profile was written.</p>",
        *(part(title, rows) for title, rows in verification.parts),
        paragraph(
            f"Residuals in just-noticeable differences (JND, {WEBER_FRACTION:.0%} of mu). Each "
            "group's mean, with its 90 % uncertainty, is to lie within "
            f"{verification.tolerance_jnd:g}. {_sizes(verification, fit)}"
        ),
        picture("Friction and residuals", _friction(fit, reduced, verification, predictor)),
        picture(
            "Residuals over force, voltage, frequency, order and time",
            _residuals_over_causes(fit, reduced, predictor, minutes),
        ),
        _ripples(fit, reduced, predictor),
        *(part(title, rows) for title, rows in fit.parts(needs)),
        listed("Rests on", rests_on),
        _raw_traces(recordings, farthest_stroke(fit, reduced, predictor)),
        paragraph(
            f"{len(fit.strokes)} strokes in the fit; they {fit.scatter}. Terms on: "
            f"{', '.join(fit.terms)}. {_crosstalk(reduced)}"
        ),
    ]
    write_whole(path, page(f"Calibration of {screen.name}", parts, verdict))


def _crosstalk(reduced: Reduced) -> str:
    seen = [p.crosstalk for p in reduced.points if np.isfinite(p.crosstalk)]
    if not seen:
        return (
            "Strokes of one direction: they do not separate the sensor's cross-talk from friction."
        )
    return f"The sensor's cross-talk, subtracted: {float(np.median(seen)):.2%} of the normal force."


def _friction(
    fit: Fit, reduced: Reduced, verification: Verification, predictor: StrokePredictor
) -> Figure:
    """Friction over force and over frequency, and the residuals."""
    figure = Figure(figsize=(12.5, 3.6), layout="constrained")
    by_force, by_frequency, rest = figure.subplots(1, 3)
    good = [point for point in reduced.points if not point.outlier]

    def friction(force: Array | float, volts: float, hertz: Array | float) -> Array:
        """Friction at 50 mm/s, NaN where the contact snaps in."""
        columns = np.broadcast_arrays(force, volts, hertz, 50.0)
        strokes = StrokeConditions(*(column.astype(float) for column in columns))
        predicted = predictor(strokes, fit.names, fit.log_values, jacobian=False)
        return np.where(predicted.is_light, np.exp(predicted.log_mu), np.nan)

    values, counts = np.unique([point.frequency_hz for point in good], return_counts=True)
    usual = float(values[counts.argmax()]) if len(values) else 125.0
    by_volts: dict[float, list[Point]] = {}
    for point in good:
        if point.frequency_hz == usual:
            by_volts.setdefault(round(point.voltage_v / 10) * 10, []).append(point)
    forces = np.geomspace(0.08, 1.0, 40)
    curves = {volts: friction(forces, volts, usual) for volts in by_volts}
    _curves(by_force, "normal_force_n", forces, curves, by_volts, "V")
    by_force.set(xlabel="normal force [N]", ylabel="friction coefficient", title=f"at {usual:g} Hz")

    highest = max((point.voltage_v for point in good), default=0.0)
    by_newtons: dict[float, list[Point]] = {}
    for point in good:
        if point.voltage_v > 0.95 * highest > 0:
            planned = min(FORCES_N, key=lambda force: abs(force - point.normal_force_n))
            by_newtons.setdefault(planned, []).append(point)
    hertz = np.geomspace(15.0, 8000.0, 60)
    curves = {force: friction(force, highest, hertz) for force in by_newtons}
    _curves(by_frequency, "frequency_hz", hertz, curves, by_newtons, "N")
    by_frequency.set(xlabel="drive frequency [Hz]", title=f"at {highest:.3g} V", xscale="log")

    _residuals(rest, fit, good, verification, predictor)
    for axes in (by_force, by_frequency, rest):
        axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def minutes_of(recordings: Sequence[StrokeRecording]) -> dict[int, float]:
    """Return minutes from the first stroke to each, by number, of strokes with a time."""
    started = {}
    for recording in recordings:
        with suppress(ValueError):
            started[recording.stroke.number] = datetime.fromisoformat(recording.conditions.started)
    first = min(started.values(), default=None)
    return {n: (t - first).total_seconds() / 60 for n, t in started.items() if first is not None}


def _residuals_over_causes(
    fit: Fit, reduced: Reduced, predictor: StrokePredictor, minutes: Mapping[int, float]
) -> Figure:
    """Draw residuals over possible causes: a slope or a step shows a systematic error."""
    figure = Figure(figsize=(12.5, 2.6), layout="constrained")
    panels = figure.subplots(1, 5 if minutes else 4, sharey=True)
    good = [point for point in reduced.points if not point.outlier]
    causes = (
        ("normal_force_n", "normal force [N]"),
        ("voltage_v", "voltage [V]"),
        ("frequency_hz", "frequency [Hz]"),
        ("number", "order"),
        *([("minutes", "time [min]")] if minutes else []),
    )
    residuals = _residuals_of(good, fit, predictor)
    for axes, (name, label) in zip(panels, causes, strict=True):
        at = np.array([getattr(p, name, minutes.get(p.number, np.nan)) for p in good], dtype=float)
        for held_out, colour in ((False, "#777"), (True, "#b40426")):
            chosen = np.array([point.held_out is held_out for point in good], dtype=bool)
            axes.plot(at[chosen], residuals[chosen], ".", color=colour)
        axes.axhline(0, color="#222", lw=0.6)
        axes.set(xlabel=label)
    panels[2].set_xscale("log")
    panels[0].set_ylabel("residual [JND]")
    return figure


def _residuals_of(points: Sequence[Point], fit: Fit, predictor: StrokePredictor) -> Array:
    """Measured minus predicted friction [JND], shape (points,)."""
    if not points:
        return np.empty(0)
    strokes = StrokeConditions.of(points)
    log_mu = predictor(strokes, fit.names, fit.log_values, jacobian=False).log_mu
    measured = np.array([point.mu for point in points])
    return np.asarray((measured / np.exp(log_mu) - 1) / WEBER_FRACTION)


def _ripples(fit: Fit, reduced: Reduced, predictor: StrokePredictor) -> str:
    """Ripples at 2f, measured and fitted, the force sensor's bandwidth included."""
    seen = [p for p in reduced.points if not p.outlier and np.isfinite(p.ripple)]
    if not seen:
        return ""
    strokes = StrokeConditions.of(seen)
    fitted = predictor(strokes, fit.names, fit.log_values, jacobian=False).ripple
    measured, sd = (np.array([getattr(p, name) for p in seen]) for name in ("ripple", "ripple_sd"))
    figure = Figure(figsize=(12.5, 2.8), layout="constrained")
    over, against = figure.subplots(1, 2)
    hertz = 2 * strokes.frequency_hz
    over.errorbar(hertz, measured, sd, fmt=".", color="#3b4cc0", label="measured")
    over.plot(hertz, fitted, "+", color="#b40426", label="fitted")
    over.set(xscale="log", xlabel="ripple's frequency 2f [Hz]", ylabel="ripple over mean friction")
    over.legend(fontsize=7)
    against.errorbar(fitted, measured - fitted, sd, fmt=".", color="#3b4cc0")
    against.axhline(0, color="#222", lw=0.6)
    against.set(xlabel="fitted ripple", ylabel="measured less fitted")
    return picture("Ripples", figure)


def _sizes(verification: Verification, fit: Fit) -> str:
    """Return the parts of the error of the profile's friction in one line, each in JND."""
    rig = max((group.rig_jnd for group in verification.groups), default=0.0)
    scatter = max((group.uncertainty_jnd for group in verification.groups), default=np.nan)
    forms = max((form.effect_jnd * form.weight for form in fit.forms), default=0.0)
    checked = f"the rig's gains {rig:.2f}"
    if any("no known weight" in text for text in verification.untested):
        checked = "the rig's gains: not checked"
    elif any("no second reading" in text for text in verification.untested):
        checked = f"the forces' gains {rig:.2f}; the volts: not checked"
    return (
        f"Friction rests on, in JND: the scatter of the held-out strokes {scatter:.2f}; "
        f"{checked}; the fit's own uncertainty {verification.fit_bound_jnd:.2f}; the form "
        f"of the model {forms:.2f}. At most: {verification.bound_jnd:.2f}."
    )


def farthest_stroke(fit: Fit, reduced: Reduced, predictor: StrokePredictor) -> int | None:
    """Number of the good stroke with the largest residual; None without strokes."""
    good = [point for point in reduced.points if not point.outlier]
    if not good:
        return None
    return good[int(np.abs(_residuals_of(good, fit, predictor)).argmax())].number


def _curves(
    axes: Axes,
    name: str,
    x: Array,
    curves: Mapping[float, Array],
    groups: Mapping[float, list[Point]],
    unit: str,
) -> None:
    """Draw a predicted curve and the measured points of each group; held-out ones are hollow."""
    for (key, points), colour in zip(sorted(groups.items()), cycle(_COLOURS), strict=False):
        axes.plot(x, curves[key], color=colour, lw=1)
        at, mu = [getattr(point, name) for point in points], [point.mu for point in points]
        axes.errorbar(at, mu, [point.mu_sd for point in points], fmt="none", ecolor=colour, lw=0.8)
        fill = ["white" if point.held_out else colour for point in points]
        axes.scatter(at, mu, s=14, color=fill, edgecolors=colour, label=f"{key:g} {unit}")


def _residuals(
    axes: Axes, fit: Fit, good: list[Point], verification: Verification, predictor: StrokePredictor
) -> None:
    if good:
        numbers = np.array([point.number for point in good])
        residual = _residuals_of(good, fit, predictor)
        held_out = np.array([point.held_out for point in good])
        axes.plot(numbers[~held_out], residual[~held_out], ".", color="#777", label="fitted")
        axes.plot(numbers[held_out], residual[held_out], "o", color="#b40426", label="kept out")
    for side in (-1, 1):
        axes.axhline(side * verification.tolerance_jnd, color="#b40426", lw=0.8, ls="--")
    axes.axhline(0, color="#222", lw=0.6)
    axes.set(xlabel="stroke", ylabel="residual [JND]", title="residuals")


def _raw_traces(recordings: Sequence[StrokeRecording], opened: int | None) -> str:
    """HTML with both forces and the place of each stroke over time, full slip shaded.

    The stroke of number `opened` is shown, the others open by a click; no script is needed.
    """
    if not recordings:
        return ""
    keys = " ".join(
        f'<span style="color:{colour}">{escape(name)}</span>' for name, colour in _TRACES.items()
    )
    parts = [
        "<h2>Raw traces</h2><p>Full slip, which alone counts, is shaded; the stroke farthest from "
        f"the fit is open. {keys}</p>"
    ]
    for recording in recordings:
        is_open = " open" if recording.stroke.number == opened else ""
        parts.append(
            f"<details{is_open}><summary>{escape(recording.stroke.label)}</summary>{_drawn(recording)}</details>"
        )
    return "".join(parts)


def _drawn(recording: StrokeRecording) -> str:
    t = recording.t_s - recording.t_s[0]
    across = t / max(float(t[-1]), 1e-9) * _WIDTH
    forces = recording.normal_force_n, recording.tangential_force_n
    low, high = min(force.min() for force in forces), max(force.max() for force in forces)
    place = recording.x_mm
    lines = [(force, low, high) for force in forces] + [(place, place.min(), place.max())]
    shaded = "".join(
        f'<rect x="{across[s.start]:.1f}" y="0" width="{across[s.stop - 1] - across[s.start]:.1f}" '
        f'height="{_HEIGHT}" fill="#1b9e77" opacity="0.15"/>'
        for s in full_slip(recording.t_s, place, recording.normal_force_n)
    )
    drawn = "".join(
        f'<polyline fill="none" stroke="{colour}" points="{_points(across, *line)}"/>'
        for line, colour in zip(lines, _TRACES.values(), strict=True)
    )
    zero = _HEIGHT * (1 - (0 - low) / max(high - low, 1e-9))
    return (
        f'<svg role="img" aria-label="raw trace of stroke {recording.stroke.number}" '
        f'viewBox="0 0 {_WIDTH} {_HEIGHT + 16}">{shaded}'
        f'<line x1="0" x2="{_WIDTH}" y1="{zero:.1f}" y2="{zero:.1f}" stroke="#999"/>{drawn}'
        f'<text x="2" y="12" font-size="12">{high:.3g} N</text>'
        f'<text x="2" y="{_HEIGHT - 2}" font-size="12">{low:.3g} N</text>'
        f'<text x="{_WIDTH - 2}" y="{_HEIGHT + 13}" font-size="12" text-anchor="end">'
        f"{t[-1]:.2f} s</text></svg>"
    )


def _points(across: Array, values: Array, low: float, high: float) -> str:
    """Points of a line: of each column of samples the lowest and the highest."""
    up = _HEIGHT * (1 - (values - low) / max(high - low, 1e-9))
    edges = np.linspace(0, len(up), min(_COLUMNS, len(up)) + 1).astype(int)[:-1]
    ends = np.minimum.reduceat(up, edges), np.maximum.reduceat(up, edges)
    pairs = zip(across[edges], *ends, strict=True)
    return " ".join(f"{x:.1f},{a:.1f} {x:.1f},{b:.1f}" for x, a, b in pairs)


def chart_picture(chart: ControlChart) -> Figure:
    """Draw a control chart [JND]."""
    figure = Figure(figsize=(9, 2.6), layout="constrained")
    axes = figure.subplots()
    axes.plot(range(1, len(chart.values) + 1), chart.values, "o-", color="#1f5fa8", ms=4, lw=1)
    for value, style in ((chart.low, "--"), (chart.middle, "-"), (chart.high, "--")):
        if np.isfinite(value):
            axes.axhline(value, color="#b40426", lw=0.8, ls=style)
    axes.set(xlabel="measurement", ylabel="change of friction [JND]")
    return figure


CERTIFICATE = "certificate.pdf"
_A4 = 8.27, 11.69
_LEFT, _RIGHT, _TOP, _BOTTOM = 0.08, 0.92, 0.95, 0.06
_LINE = 0.0155  # of the page's height
_CHARACTERS = 108  # characters of a line


class _Sheets:
    """Pages written from the top down; a full page is followed by a new one."""

    def __init__(self, footer: str) -> None:
        self._footer, self._y = footer, 0.0
        self._figures: list[Figure] = []

    def begin(self) -> None:
        """Begin a new page."""
        self._figures.append(Figure(figsize=_A4))
        self._y = _TOP

    def save(self, pages: PdfPages) -> None:
        """Write all, each with its number of so many."""
        for number, figure in enumerate(self._figures, 1):
            foot = f"{self._footer}, page {number} of {len(self._figures)}"
            figure.text(_LEFT, _BOTTOM / 2, foot, size=7, color="#555")
            pages.savefig(figure)  # type: ignore[no-untyped-call]

    def line(self, cells: Sequence[tuple[float, str]], size: float = 8, bold: bool = False) -> None:
        """Write texts at shares of the width, on one line."""
        if self._y < _BOTTOM or not self._figures:
            self.begin()
        for at, text in cells:
            x = _LEFT + at * (_RIGHT - _LEFT)
            weight = "bold" if bold else "normal"
            shown = text.replace("$", r"\$")  # no formulas
            self._figures[-1].text(x, self._y, shown, size=size, va="top", weight=weight)
        self._y -= _LINE * max(size / 8, 1.0)

    def write(self, text: str) -> None:
        """Write the lines of a template.

        ``# title``, ``## heading``, ``name :: value``, ``| name = value | ... |`` as rows of one
        table, ``~ n`` for n empty lines, ``__`` to sign, ``---`` for a new page; other lines are
        text. Empty lines are left out.
        """
        table: list[dict[str, str]] = []
        lines = (line.strip() for line in text.splitlines())
        for line in [*(line for line in lines if line), ""]:
            if table and not line.startswith("|"):
                self._table(table)
                table = []
            name, separator, value = line.partition(" :: ")
            if line.startswith("|"):
                cells = (cell.partition(" = ") for cell in line.strip("| ").split(" | "))
                table.append({name.strip(): value.strip() for name, _, value in cells})
            elif line.startswith("## "):
                self._y -= 0.6 * _LINE
                self.line([(0, line[3:])], 10, bold=True)
            elif line.startswith("# "):
                self.line([(0, line[2:])], 16, bold=True)
                self._y -= 0.6 * _LINE
            elif line == "---":
                self.begin()
            elif line == "__":
                self.line([(0, "_" * 40), (0.5, "_" * 40)])
                self.line([(0, "name"), (0.5, "date and signature")], 7)
            elif line.startswith("~"):
                self._y -= float(line[1:] or 1) * _LINE
            elif separator:
                for number, part_of in enumerate(wrap(value, _CHARACTERS - 26) or [""]):
                    self.line([(0, "" if number else name), (0.22, part_of)])
            else:
                for part_of in wrap(line, _CHARACTERS):
                    self.line([(0, part_of)])

    def _table(self, rows: Sequence[dict[str, str]]) -> None:
        """Write rows below their headings, as wide as their texts."""
        heads = list(rows[0])
        # Headings are bold, and a sixth wider than texts of as many characters.
        widths = np.array([max(1.17 * len(h), *(len(r[h]) for r in rows)) + 1.5 for h in heads])
        starts = np.concatenate([[0], np.cumsum(widths)[:-1]]) / max(widths.sum(), _CHARACTERS)
        size = min(8.0, 8.0 * _CHARACTERS / widths.sum())
        self.line(list(zip(starts, heads, strict=True)), size, bold=True)
        for cells in rows:
            self.line(list(zip(starts, (cells[head] for head in heads), strict=True)), size)


class CertificateText(Document):
    """Statements of a laboratory on its certificates, as a file; the sheet names missing ones."""

    laboratory: str = ""
    address: str = ""
    customer: str = ""
    place: str = ""
    """Who issues it, for whom, and where was measured."""
    panel_serial: str = ""
    condition: str = ""
    """Serial number of the panel, and how it came."""
    method: str = (
        "haptix calibrate: strokes of a finger, fit of the contact, strokes kept out of it"
    )
    decision_rule: str = (
        "passed where the error of each group of strokes, with its uncertainty at 95 % on one "
        "side, is within the tolerance (two one-sided tests); no risk is shared with the customer"
    )
    """How it was measured, and how a verdict counts the uncertainty."""
    agreed_due_on: date | None = None
    """When to measure again, only where the customer has agreed."""
    traceability: dict[str, str] = Field(default={})
    """Of the weight, the voltmeter, the driver: to which standard."""
    template: Path | None = None
    """Jinja template in place of the one that comes with haptix."""


def stated(value: float, expanded: float, unit: str = "") -> str:
    """Return a value with its uncertainty, which has two digits (GUM 7.2.6).

    Examples
    --------
    >>> stated(5.71e-7, 1.63e-7, "m")
    '(570 ± 160) nm'
    >>> stated(0.2416, 0.0037, "1")
    '0.2416 ± 0.0037'
    """
    unit = "" if unit == "1" else unit
    power = 3 * floor(log10(abs(value)) / 3) if value and not 1e-2 <= abs(value) < 1e4 else 0
    digits = 1 - floor(log10(expanded / 10**power)) if expanded > 0 else 3
    rounded = (round(number / 10**power, digits) for number in (value, expanded))
    text = " ± ".join(f"{number:.{max(0, digits)}f}" for number in rounded)
    if power == 0:
        return f"{text} {unit}".strip()
    prefix = _PREFIXES.get(power) if unit == "m" else None
    return f"({text}) {prefix}m" if prefix else f"({text})e{power} {unit}".strip()


_PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m"}


def _result(budget: Budget) -> dict[str, str]:
    """Return a quantity with its expanded uncertainty at 95 %, by its degrees of freedom."""
    k = float(student.ppf(0.975, min(budget.freedom, 1e6)))
    expanded = k * budget.standard_uncertainty * budget.value
    value = stated(budget.value, expanded, budget.unit)
    return {"quantity": budget.quantity, "value": value, "k": f"{k:.2f}"}


def _rows(rows: Iterable[Mapping[str, str]]) -> list[str]:
    return ["| " + " | ".join(f"{k} = {v}" for k, v in cells.items()) + " |" for cells in rows]


def write_certificate(
    path: Path,
    screen: Screen,
    finger: Finger,
    fit: Fit,
    verification: Verification,
    recordings: Sequence[StrokeRecording],
    instruments: Instruments,
    rig: RigCheck | None = None,
    about: CertificateText | None = None,
) -> str:
    """Write the certificate of a verified profile by a template, and return its number.

    Raises `InputError` if the verification failed, an instrument did not hold on the day of a
    stroke, or the template is wrong.
    """
    from jinja2 import StrictUndefined, TemplateError
    from jinja2.sandbox import SandboxedEnvironment

    made, about = screen.calibration, about or CertificateText()
    if made is None or verification.failures:
        why = "; ".join(verification.failures) or "the screen has no calibration"
        raise InputError(f"expected a calibration that passed, or is provisional: {why}")
    instruments.check_strokes(recordings)
    number = f"{made.date:%Y%m%d}-{screen.calibration_id[:8]}"
    pair = described(finger, screen)
    rooms = [recording.conditions for recording in recordings]
    drivers = {conditions.instruments.get("driver", "") for conditions in rooms} - {""}
    used = {tuple(pair) for conditions in rooms for pair in conditions.instruments.items()}
    evidence = []
    for budget in verification.budget:
        cells = ({k: v for k, v in row(part).items() if k != "quantity"} for part in budget.main)
        evidence += [f"## Uncertainty budget of {budget.quantity}", *_rows(cells)]
    hashes = {"screen.toml": screen.content_hash(), "finger.toml": made.finger_hash,
              "fit.json": fit.content_hash}  # fmt: skip
    hashes |= {k: v for k, v in sorted(fit.made_from.items()) if not k.startswith("strokes/")}
    evidence += [
        "## Errors of friction, by the strokes kept out of the fit",
        *_rows(map(row, verification.groups)),
        f"Steadiness :: {verification.steadiness.text}",
        f"{fit.shear} :: {fit.shear_note}",
        "## Rests on",
        *made.rests_on,
        "## Hashes (SHA-256)",
        *(f"{name} :: {digest}" for name, digest in hashes.items()),
        f"strokes :: {len(recordings)} files, named with their hashes in fit.json",
    ]
    day = None if rig is None else rig.measured_on or "a day that is not known"
    said = {
        "number": number, "missing": "not stated", "about": about, "screen": screen, "made": made,
        "is_practice": made.is_virtual, "finger": f"{pair['finger']} ({pair['pair']})",
        "force_n": FORCE_N, "speed_mm_per_s": SPEED_MM_PER_S, "verification": verification,
        "issued_on": datetime.now(UTC).date(), "environment": environment(recordings),
        "drivers": ", ".join(sorted(drivers)), "version": __version__, "theory": fit.theory,
        "results": [_result(budget) for budget in verification.budget],
        "instruments": [
            line.strip("| ") for line in _rows(
                row(one) for one in instruments.instruments if (one.name, one.serial) in used)
        ],
        "rig_checked": "" if rig is None else f"{day}, with {', '.join(rig.instruments)}",
        "evidence": "\n".join(evidence),
    }  # fmt: skip
    template = about.template or Path(__file__).with_name("certificate_template.txt")
    try:
        text = SandboxedEnvironment(undefined=StrictUndefined).from_string(read_text(template))
        lines = text.render(said)
    except TemplateError as error:
        raise InputError(f"{template}: expected a Jinja template: {error}") from None
    content = BytesIO()
    metadata = {"Title": f"Certificate {number}", "Creator": "haptix", "CreationDate": None}
    with rc_context({"pdf.fonttype": 42}), PdfPages(content, metadata=metadata) as pages:
        sheets = _Sheets(f"Certificate {number} of {screen.name}")
        sheets.write(lines)
        sheets.save(pages)
    write_whole(path, content.getvalue())
    return number


def environment(recordings: Sequence[StrokeRecording]) -> str:
    """Return the room's temperature and humidity, where recorded."""
    words = []
    for name, unit in (("temperature_c", "°C"), ("humidity_percent", "%")):
        read = [getattr(recording.conditions, name) for recording in recordings]
        values = [value for value in read if value is not None]
        word = name.split("_")[0]
        if not values:
            words.append(f"{word} not recorded")
        elif min(values) == max(values):
            words.append(f"{word} {values[0]:.3g} {unit}")
        else:
            words.append(f"{word} {min(values):.3g} to {max(values):.3g} {unit}")
    return ", ".join(words)
