"""The documents of a calibration: its report, an HTML page, and its certificate, a PDF.

The page has its pictures inside and needs no network. The certificate is one page with an appendix
of its evidence.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from datetime import datetime, timedelta
from html import escape
from io import BytesIO
from itertools import cycle
from pathlib import Path
from textwrap import wrap

import numpy as np

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
from calibration.verify.verification import Verification
from haptix.base.errors import InputError, from_extra
from haptix.base.files import write_whole
from haptix.base.report import listed, page, paragraph, part, picture, row
from haptix.base.version import __version__
from haptix.model.finger import Finger
from haptix.model.pair import described
from haptix.model.perception.thresholds import WEBER_FRACTION
from haptix.model.screen import CALIBRATION_VALID_DAYS, Screen

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
            f"{len(fit.strokes)} strokes in the fit; they repeat within "
            f"{fit.repeatability.log_mu:.1%} in mu beyond their own errors. Terms on: "
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


class _Page:
    """Pages written from the top down; a full page is followed by a new one."""

    def __init__(self, pages: PdfPages, footer: str) -> None:
        self._pages, self._footer = pages, footer
        self.count = 0
        self._figure: Figure | None = None
        self._y = 0.0

    def begin(self) -> None:
        """Begin a new page."""
        self.end()
        self.count += 1
        self._figure, self._y = Figure(figsize=_A4), _TOP

    def end(self) -> None:
        """Keep the page that is written."""
        if self._figure is not None:
            foot = f"{self._footer}, page {self.count}"
            self._figure.text(_LEFT, _BOTTOM / 2, foot, size=7, color="#555")
            self._pages.savefig(self._figure)  # type: ignore[no-untyped-call]
            self._figure = None

    def line(self, cells: Sequence[tuple[float, str]], size: float = 8, bold: bool = False) -> None:
        """Write texts at shares of the width, on one line."""
        if self._y < _BOTTOM or self._figure is None:
            self.begin()
        assert self._figure is not None
        for at, text in cells:
            x = _LEFT + at * (_RIGHT - _LEFT)
            weight = "bold" if bold else "normal"
            shown = text.replace("$", r"\$")  # no formulas
            self._figure.text(x, self._y, shown, size=size, va="top", weight=weight)
        self._y -= _LINE * max(size / 8, 1.0)

    def space(self, lines: float = 0.6) -> None:
        """Leave some room."""
        self._y -= lines * _LINE

    def heading(self, text: str) -> None:
        """Write a heading."""
        self.space()
        self.line([(0, text)], 10, bold=True)

    def pairs(self, rows: Iterable[tuple[str, str]]) -> None:
        """Write names and their values; long values are wrapped."""
        for name, what in rows:
            for number, text in enumerate(wrap(what, _CHARACTERS - 26) or [""]):
                self.line([(0, "" if number else name), (0.22, text)])

    def table(self, rows: Sequence[dict[str, str]]) -> None:
        """Write rows below their headings, as wide as their texts."""
        if not rows:
            return
        heads = list(rows[0])
        widths = np.array([max(len(h), *(len(r[h]) for r in rows)) + 1.5 for h in heads])
        starts = np.concatenate([[0], np.cumsum(widths)[:-1]]) / max(widths.sum(), _CHARACTERS)
        size = min(8.0, 8.0 * _CHARACTERS / widths.sum())
        self.line(list(zip(starts, heads, strict=True)), size, bold=True)
        for cells in rows:
            self.line(list(zip(starts, cells.values(), strict=True)), size)


def write_certificate(
    path: Path,
    screen: Screen,
    finger: Finger,
    fit: Fit,
    verification: Verification,
    recordings: Sequence[StrokeRecording],
    instruments: Instruments,
    rig: RigCheck | None = None,
) -> str:
    """Write the certificate of a verified profile, and return its number.

    Raises
    ------
    InputError
        If the verification failed, or an instrument did not hold on the day of a stroke.
    """
    made = screen.calibration
    if made is None or verification.failures:
        why = "; ".join(verification.failures) or "the screen has no calibration"
        raise InputError(f"expected a calibration that passed, or is provisional: {why}")
    instruments.check_strokes(recordings)
    number = f"{made.date:%Y%m%d}-{screen.calibration_id[:8]}"
    about = described(finger, screen)
    rooms = [recording.conditions for recording in recordings]
    drivers = {conditions.instruments.get("driver", "") for conditions in rooms} - {""}
    used = {tuple(pair) for conditions in rooms for pair in conditions.instruments.items()}
    shown = [
        instrument
        for instrument in instruments.instruments
        if (instrument.name, instrument.serial) in used
    ]
    content = BytesIO()
    metadata = {"Title": f"Certificate {number}", "Creator": "haptix", "CreationDate": None}
    with rc_context({"pdf.fonttype": 42}), PdfPages(content, metadata=metadata) as pages:
        sheet = _Page(pages, f"Certificate {number} of {screen.name}")
        sheet.begin()
        practice = ": a practice, of no screen" if made.is_virtual else ""
        sheet.line([(0, f"Certificate of calibration{practice}")], 16, bold=True)
        sheet.space()
        sheet.pairs(
            [
                ("Number", number),
                ("Panel", screen.name),
                ("Finger", f"{about['finger']} ({about['pair']})"),
                ("Driver", ", ".join(sorted(drivers)) or "not named"),
                ("Operator", made.operator or "not named"),
                ("Measured on", f"{made.date}"),
                ("Due on", f"{made.date + timedelta(days=CALIBRATION_VALID_DAYS)}"),
                ("Environment", environment(recordings)),
                ("Software", f"haptix {__version__}, theory {fit.theory}"),
            ]
        )
        sheet.heading(f"Verdict: {verification.verdict}")
        sheet.pairs(
            [
                ("Friction", f"within {verification.bound_jnd:.2f} just-noticeable differences "
                 f"(JND, 11 %) at most; {verification.tolerance_jnd:g} are allowed"),
                ("Contrast mu(V)/mu(0)", verification.contrast_text),
                ("Verified for", "nothing" if made.verified is None else made.verified.text),
                *(("Not tested", text) for text in verification.untested),
            ]
        )  # fmt: skip
        sheet.heading("Results, with intervals of 90 %")
        sheet.table([row(budget) for budget in verification.budget])
        sheet.heading("Instruments")
        sheet.table([row(instrument) for instrument in shown])
        if rig is not None:
            day = "on a day that is not known" if rig.measured_on is None else f"{rig.measured_on}"
            sheet.pairs([("Rig checked", f"{day}, with {', '.join(rig.instruments)}")])
        sheet.heading("Signature")
        sheet.space(3)
        sheet.line([(0, "_" * 40), (0.5, "_" * 40)])
        sheet.line([(0, "name"), (0.5, "date and signature")], 7)
        sheet.begin()
        sheet.line([(0, "Appendix")], 14, bold=True)
        for budget in verification.budget:
            sheet.heading(f"Uncertainty budget of {budget.quantity}")
            cells = [row(part) for part in budget.main]
            sheet.table([{k: v for k, v in cell.items() if k != "quantity"} for cell in cells])
        sheet.heading("Errors of friction, by the strokes kept out of the fit")
        sheet.table([row(group) for group in verification.groups])
        sheet.pairs([("Steadiness", verification.steadiness.text)])
        sheet.pairs([(fit.shear, fit.shear_note)])
        sheet.heading("Rests on")
        sheet.pairs([("", text) for text in made.rests_on])
        sheet.heading("Hashes (SHA-256)")
        sheet.pairs([("screen.toml", screen.content_hash()), ("finger.toml", made.finger_hash),
                     ("fit.json", fit.content_hash)])  # fmt: skip
        sheet.pairs([(name, digest) for name, digest in sorted(fit.made_from.items())
                     if not name.startswith("strokes/")])  # fmt: skip
        sheet.pairs([("strokes", f"{len(recordings)} files, named with their hashes in fit.json")])
        sheet.end()
    write_whole(path, content.getvalue())
    return number


def environment(recordings: Sequence[StrokeRecording]) -> str:
    """Return the room's temperature and humidity, where recorded."""
    said = []
    for name, unit in (("temperature_c", "°C"), ("humidity_percent", "%")):
        read = [getattr(recording.conditions, name) for recording in recordings]
        values = [value for value in read if value is not None]
        word = name.split("_")[0]
        if not values:
            said.append(f"{word} not recorded")
        elif min(values) == max(values):
            said.append(f"{word} {values[0]:.3g} {unit}")
        else:
            said.append(f"{word} {min(values):.3g} to {max(values):.3g} {unit}")
    return ", ".join(said)
