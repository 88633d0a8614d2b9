"""One page about a calibration, as HTML with its pictures inside: no network, no other file."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Sequence
from html import escape
from math import inf
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calibration.comparison import TermNeed
from calibration.fitting import Fit, ParameterEstimate, refusal
from calibration.parameters import Array
from calibration.predict import StrokeConditions, StrokePredictor
from calibration.protocol import FORCES_N
from calibration.reduction import Point, Reduced
from calibration.verification import Verification
from haptix.files import write_whole
from haptix.perception import WEBER_FRACTION
from haptix.screen import Screen

_STYLE = """
body{font:14px/1.4 system-ui,sans-serif;max-width:60em;margin:1em auto;padding:0 1em;color:#222}
table{border-collapse:collapse;margin:.5em 0}td,th{padding:.1em .7em;text-align:left;
border-bottom:1px solid #ddd}td.n{text-align:right}h1{font-size:1.4em}h2{font-size:1.1em}
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
        As calibrated, or as it was where no profile could be made.
    fit, reduced, verification, predictor, needs
        What the steps have found.
    profile_is_written : bool
        False where the insulator is not determined.

    Raises
    ------
    FileFormatError
        If the file cannot be written.
    """
    verdict = "passed" if verification.passed else "failed"
    picture = _picture(fit, reduced, verification, predictor)
    calibration = screen.calibration
    about = (
        ""
        if calibration is None
        else (
            f"{calibration.date}, operator {calibration.operator or 'not named'}, "
            f"{', '.join(calibration.instruments) or 'no instruments named'}"
        )
    )
    parts = [
        f"<h1>Calibration of {escape(screen.name)}: <span class={verdict}>{verdict}</span></h1>",
        f"<p>{escape(about)}</p>" if about else "",
        "" if profile_is_written else "<p class=failed>No profile was written.</p>",
        _list("Why it failed", verification.failures),
        f'<img alt="friction and residuals" src="{picture}">',
        "<h2>What was found</h2>",
        _table(
            ("parameter", "value", "90 % interval", "spread", ""), map(_estimate_row, fit.estimates)
        ),
        _list("Not determined", [refusal(e) for e in fit.estimates if e.value is None]),
        "<h2>Strokes kept out of the fit</h2>",
        _table(
            ("stroke", "F_N [N]", "V0 [V]", "f [Hz]", "mu", "predicted", "thresholds", "ripple"),
            (
                (
                    str(row.number),
                    *(
                        f"{value:.3g}"
                        for value in (
                            row.normal_force_n,
                            row.voltage_v,
                            row.frequency_hz,
                            row.mu,
                            row.predicted_mu,
                        )
                    ),
                    f"{row.residual_thresholds:+.2f}",
                    _signed(row.ripple_residual_thresholds),
                )
                for row in verification.rows
            ),
        ),
        f"<p>Residuals in difference thresholds ({WEBER_FRACTION:.0%} of mu); "
        f"{verification.tolerance_thresholds:g} are allowed.</p>",
        _needs(needs),
        _list(
            "Strokes that were not used",
            [f"stroke {number}: {why}" for number, why in sorted(fit.left_out.items())],
        ),
        _list("Rests on", () if calibration is None else calibration.rests_on),
        f"<p><small>{len(fit.strokes)} strokes in the fit; they repeat within "
        f"{fit.repeatability.log_mu:.1%} in mu beyond their own errors. Terms on: "
        f"{escape(', '.join(fit.terms))}. {_crosstalk(reduced)}</small></p>",
    ]
    page = (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Calibration of '
        f"{escape(screen.name)}</title><style>{_STYLE}</style></head><body>"
        + "\n".join(filter(None, parts))
        + "</body></html>\n"
    )
    write_whole(path, page)


def _estimate_row(one: ParameterEstimate) -> tuple[str, ...]:
    value = "not determined" if one.value is None else f"{one.value:.4g}"
    if one.verdict == "fixed":
        return one.name, value, "", "", "fixed"
    high = "∞" if one.high == inf else f"{one.high:.3g}"
    return one.name, value, f"{one.low:.3g} to {high}", f"{one.spread:.1%}", one.verdict


def _needs(needs: Sequence[TermNeed]) -> str:
    if not needs:
        return ""
    rows = (
        (
            one.term,
            "on" if one.is_on else "off",
            one.need,
            f"{one.evidence:+.1f}",
            f"{one.effect_thresholds:.2g}",
        )
        for one in needs
    )
    head = ("term", "in the fit", "the strokes say", "evidence (AICc)", "effect [thresholds]")
    return "<h2>Which terms the strokes need</h2>" + _table(head, rows)


def _crosstalk(reduced: Reduced) -> str:
    seen = [p.crosstalk for p in reduced.points if np.isfinite(p.crosstalk)]
    if not seen:
        return "Strokes of one direction: cross-talk of the sensor cannot be told from friction."
    return f"Cross-talk of the sensor, taken off: {float(np.median(seen)):.2%} of the normal force."


def _signed(value: float) -> str:
    return f"{value:+.2f}" if np.isfinite(value) else "-"


def _list(title: str, lines: Iterable[str]) -> str:
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return f"<h2>{title}</h2><ul>{items}</ul>" if items else ""


def _table(head: Iterable[str], rows: Iterable[tuple[str, ...]]) -> str:
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return "<table><tr>" + "".join(f"<th>{escape(h)}</th>" for h in head) + f"</tr>{body}</table>"


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
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()


def _usual_frequency(good: list[Point]) -> float:
    values, counts = np.unique([point.frequency_hz for point in good], return_counts=True)
    return float(values[counts.argmax()]) if len(values) else 125.0


def _curve(fit: Fit, predictor: StrokePredictor, *conditions: Array) -> Array:
    size = np.broadcast_shapes(*(c.shape for c in conditions))
    strokes = StrokeConditions(*(np.broadcast_to(c, size).astype(float) for c in conditions))
    found = predictor(strokes, fit.names, fit.log_values, jacobian=False)
    return np.where(found.is_light, np.exp(found.log_mu), np.nan)


def _friction_by_force(axes: Axes, fit: Fit, good: list[Point], predictor: StrokePredictor) -> None:
    hertz = _usual_frequency(good)
    shown = [point for point in good if point.frequency_hz == hertz]
    forces = np.geomspace(0.08, 1.0, 40)
    for index, volts in enumerate(sorted({round(point.voltage_v / 10) * 10 for point in shown})):
        colour = _COLOURS[index % len(_COLOURS)]
        mu = _curve(fit, predictor, forces, np.array(volts), np.array(hertz), np.array(50.0))
        axes.plot(forces, mu, color=colour, lw=1)
        here = [point for point in shown if round(point.voltage_v / 10) * 10 == volts]
        _dots(axes, [p.normal_force_n for p in here], here, colour, f"{volts:g} V")
    axes.set(xlabel="normal force [N]", ylabel="friction coefficient", title=f"at {hertz:g} Hz")
    axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _friction_by_frequency(
    axes: Axes, fit: Fit, good: list[Point], predictor: StrokePredictor
) -> None:
    highest = max((point.voltage_v for point in good), default=0.0)
    shown = [point for point in good if point.voltage_v > 0.95 * highest and highest > 0]
    hertz = np.geomspace(15.0, 8000.0, 60)
    for index, force in enumerate(sorted({_planned(point) for point in shown})):
        colour = _COLOURS[index % len(_COLOURS)]
        mu = _curve(fit, predictor, np.array(force), np.array(highest), hertz, np.array(50.0))
        axes.semilogx(hertz, mu, color=colour, lw=1)
        here = [point for point in shown if _planned(point) == force]
        _dots(axes, [p.frequency_hz for p in here], here, colour, f"{force:g} N")
    axes.set(xlabel="drive frequency [Hz]", title=f"at {highest:.3g} V")
    axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _planned(point: Point) -> float:
    """The protocols' force that is nearest to the measured one [N]."""
    return min(FORCES_N, key=lambda force: abs(force - point.normal_force_n))


def _residuals(
    axes: Axes, fit: Fit, good: list[Point], verification: Verification, predictor: StrokePredictor
) -> None:
    if good:
        strokes = StrokeConditions.of(good)
        log_mu = predictor(strokes, fit.names, fit.log_values, jacobian=False).log_mu
        numbers = np.array([point.number for point in good])
        thresholds = (np.array([p.mu for p in good]) / np.exp(log_mu) - 1) / WEBER_FRACTION
        held_out = np.array([point.held_out for point in good])
        axes.plot(numbers[~held_out], thresholds[~held_out], ".", color="#777", label="fitted")
        axes.plot(numbers[held_out], thresholds[held_out], "o", color="#b40426", label="kept out")
    for side in (-1, 1):
        axes.axhline(side * verification.tolerance_thresholds, color="#b40426", lw=0.8, ls="--")
    axes.axhline(0, color="#222", lw=0.6)
    axes.set(xlabel="stroke", ylabel="residual [difference thresholds]", title="residuals")
    axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _dots(axes: Axes, x: list[float], points: list[Point], colour: str, label: str) -> None:
    fitted = [not point.held_out for point in points]
    mu, sd = [point.mu for point in points], [point.mu_sd for point in points]
    axes.errorbar(x, mu, sd, fmt="none", ecolor=colour, lw=0.8)
    axes.scatter(
        x,
        mu,
        s=14,
        color=[colour if kept else "white" for kept in fitted],
        edgecolors=colour,
        label=label,
    )
