"""The report of a calibration: one HTML page with its picture inside, without network."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from math import inf
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calibration.comparison import TermNeed
from calibration.fit import Fit, ParameterEstimate
from calibration.parameters import Array
from calibration.predict import StrokeConditions, StrokePredictor
from calibration.protocol import FORCES_N
from calibration.reduction import Point, Reduced
from calibration.verification import HeldOutStroke, Verification
from haptix.files import write_whole
from haptix.perception import WEBER_FRACTION
from haptix.screen import Screen

_STYLE = """
body{font:14px/1.4 system-ui,sans-serif;max-width:60em;margin:1em auto;padding:0 1em;color:#222}
table{border-collapse:collapse;margin:.5em 0}td,th{padding:.1em .7em;text-align:left;
border-bottom:1px solid #ddd}h1{font-size:1.4em}h2{font-size:1.1em}
.passed{color:#1a6e1a}.failed{color:#a81111}img{max-width:100%}small{color:#555}
"""
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
) -> None:
    """Write the page.

    Parameters
    ----------
    path : path-like
        HTML file.
    screen : Screen
        As calibrated, or as it was believed to be where there is no profile.
    fit, reduced, verification, predictor, needs
        Results of the steps.
    profile_is_written : bool
        False where the insulator is not determined.

    Raises
    ------
    FileFormatError
        If the file cannot be written.
    """
    picture = _picture(fit, reduced, verification, predictor)
    calibration, verdict = screen.calibration, verification.verdict
    about, rests_on = "", tuple[str, ...]()
    if calibration is not None:
        about = (
            f"{calibration.date}, operator {calibration.operator or 'not named'}, "
            f"{', '.join(calibration.instruments) or 'no instruments named'}"
        )
        rests_on = calibration.rests_on
    left_out = [f"stroke {number}: {why}" for number, why in sorted(fit.left_out.items())]
    parts = [
        f"<h1>Calibration of {escape(screen.name)}: <span class={verdict}>{verdict}</span></h1>",
        f"<p>{escape(about)}</p>",
        "" if profile_is_written else "<p class=failed>No profile was written.</p>",
        _list("Why it failed", verification.failures),
        f'<img alt="friction and residuals" src="{picture}">',
        _table("Results", [_estimate_row(one) for one in fit.estimates]),
        _list("Not determined", [one.refusal() for one in fit.undetermined]),
        _table("Strokes kept out of the fit", [_held_out_row(row) for row in verification.rows]),
        f"<p>Residuals in just-noticeable differences (JND, {WEBER_FRACTION:.0%} of mu); "
        f"{verification.tolerance_thresholds:g} are allowed.</p>",
        _table("Which terms the strokes need", [one.row() for one in needs]),
        _list("Strokes that were not used", left_out),
        _list("Rests on", rests_on),
        f"<p><small>{len(fit.strokes)} strokes in the fit; they repeat within "
        f"{fit.repeatability.log_mu:.1%} in mu beyond their own errors. Terms on: "
        f"{escape(', '.join(fit.terms))}. {_crosstalk(reduced)}</small></p>",
    ]
    body = "\n".join(filter(None, parts))
    write_whole(
        path,
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Calibration of '
        f"{escape(screen.name)}</title><style>{_STYLE}</style></head><body>{body}</body></html>\n",
    )


def _estimate_row(one: ParameterEstimate) -> dict[str, str]:
    is_fixed = one.verdict == "fixed"
    high = "∞" if one.high == inf else f"{one.high:.3g}"
    return {
        "parameter": one.name,
        "value": "not determined" if one.value is None else f"{one.value:.4g}",
        "90 % interval": "" if is_fixed else f"{one.low:.3g} to {high}",
        "spread": "" if is_fixed else f"{one.spread:.1%}",
        "": one.verdict,
    }


def _held_out_row(row: HeldOutStroke) -> dict[str, str]:
    ripple = row.ripple_residual_thresholds
    return {
        "stroke": str(row.number),
        "F_N [N]": f"{row.normal_force_n:.3g}",
        "V0 [V]": f"{row.voltage_v:.3g}",
        "f [Hz]": f"{row.frequency_hz:.3g}",
        "mu": f"{row.mu:.3g}",
        "predicted": f"{row.predicted_mu:.3g}",
        "residual [JND]": f"{row.residual_thresholds:+.2f}",
        "ripple [JND]": f"{ripple:+.2f}" if np.isfinite(ripple) else "-",
    }


def _crosstalk(reduced: Reduced) -> str:
    seen = [p.crosstalk for p in reduced.points if np.isfinite(p.crosstalk)]
    if not seen:
        return "Strokes of one direction: cross-talk of the sensor cannot be told from friction."
    return f"The sensor's cross-talk, subtracted: {float(np.median(seen)):.2%} of the normal force."


def _list(title: str, lines: Iterable[str]) -> str:
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return f"<h2>{title}</h2><ul>{items}</ul>" if items else ""


def _table(title: str, rows: Sequence[Mapping[str, str]]) -> str:
    if not rows:
        return ""
    head = "".join(f"<th>{escape(name)}</th>" for name in rows[0])
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row.values()) + "</tr>"
        for row in rows
    )
    return f"<h2>{title}</h2><table><tr>{head}</tr>{body}</table>"


def _picture(
    fit: Fit, reduced: Reduced, verification: Verification, predictor: StrokePredictor
) -> str:
    """Data URI of a PNG."""
    figure = Figure(figsize=(12.5, 3.6), layout="constrained")
    by_force, by_frequency, rest = figure.subplots(1, 3)
    good = [point for point in reduced.points if not point.outlier]
    _friction_by_force(by_force, fit, good, predictor)
    _friction_by_frequency(by_frequency, fit, good, predictor)
    _residuals(rest, fit, good, verification, predictor)
    for axes in (by_force, by_frequency, rest):
        axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()


def _curve(
    fit: Fit,
    predictor: StrokePredictor,
    normal_force_n: Array | float,
    voltage_v: float,
    frequency_hz: Array | float,
) -> Array:
    """Friction at 50 mm/s, NaN where the contact snaps in."""
    columns = np.broadcast_arrays(normal_force_n, voltage_v, frequency_hz, 50.0)
    strokes = StrokeConditions(*(column.astype(float) for column in columns))
    found = predictor(strokes, fit.names, fit.log_values, jacobian=False)
    return np.where(found.is_light, np.exp(found.log_mu), np.nan)


def _friction_by_force(axes: Axes, fit: Fit, good: list[Point], predictor: StrokePredictor) -> None:
    values, counts = np.unique([point.frequency_hz for point in good], return_counts=True)
    hertz = float(values[counts.argmax()]) if len(values) else 125.0
    forces = np.geomspace(0.08, 1.0, 40)
    groups: dict[int, list[Point]] = {}
    for point in good:
        if point.frequency_hz == hertz:
            groups.setdefault(round(point.voltage_v / 10) * 10, []).append(point)
    for index, (volts, points) in enumerate(sorted(groups.items())):
        colour = _COLOURS[index % len(_COLOURS)]
        axes.plot(forces, _curve(fit, predictor, forces, volts, hertz), color=colour, lw=1)
        _dots(axes, [point.normal_force_n for point in points], points, colour, f"{volts:g} V")
    axes.set(xlabel="normal force [N]", ylabel="friction coefficient", title=f"at {hertz:g} Hz")


def _friction_by_frequency(
    axes: Axes, fit: Fit, good: list[Point], predictor: StrokePredictor
) -> None:
    highest = max((point.voltage_v for point in good), default=0.0)
    hertz = np.geomspace(15.0, 8000.0, 60)
    groups: dict[float, list[Point]] = {}
    for point in good:
        if point.voltage_v > 0.95 * highest > 0:
            planned = min(FORCES_N, key=lambda force: abs(force - point.normal_force_n))
            groups.setdefault(planned, []).append(point)
    for index, (force, points) in enumerate(sorted(groups.items())):
        colour = _COLOURS[index % len(_COLOURS)]
        axes.semilogx(hertz, _curve(fit, predictor, force, highest, hertz), color=colour, lw=1)
        _dots(axes, [point.frequency_hz for point in points], points, colour, f"{force:g} N")
    axes.set(xlabel="drive frequency [Hz]", title=f"at {highest:.3g} V")


def _residuals(
    axes: Axes, fit: Fit, good: list[Point], verification: Verification, predictor: StrokePredictor
) -> None:
    if good:
        strokes = StrokeConditions.of(good)
        log_mu = predictor(strokes, fit.names, fit.log_values, jacobian=False).log_mu
        numbers = np.array([point.number for point in good])
        residual = (np.array([point.mu for point in good]) / np.exp(log_mu) - 1) / WEBER_FRACTION
        held_out = np.array([point.held_out for point in good])
        axes.plot(numbers[~held_out], residual[~held_out], ".", color="#777", label="fitted")
        axes.plot(numbers[held_out], residual[held_out], "o", color="#b40426", label="kept out")
    for side in (-1, 1):
        axes.axhline(side * verification.tolerance_thresholds, color="#b40426", lw=0.8, ls="--")
    axes.axhline(0, color="#222", lw=0.6)
    axes.set(xlabel="stroke", ylabel="residual [JND]", title="residuals")


def _dots(axes: Axes, x: list[float], points: list[Point], colour: str, label: str) -> None:
    mu = [point.mu for point in points]
    fill = ["white" if point.held_out else colour for point in points]
    axes.errorbar(x, mu, [point.mu_sd for point in points], fmt="none", ecolor=colour, lw=0.8)
    axes.scatter(x, mu, s=14, color=fill, edgecolors=colour, label=label)
