"""``haptix calibrate reduce``, ``fit`` and ``verify``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from calibration.options import Measured
from haptix.desk import option
from haptix.errors import InputError
from haptix.fields import FileThere, Positive, TermName
from haptix.files import json_text
from haptix.report import record
from haptix.terminal import AsJson, show

if TYPE_CHECKING:
    from calibration.verification import Verification


def _numbers(
    option: str, texts: Sequence[str] | None, form: str
) -> list[tuple[str, tuple[float, ...]]]:
    """Read options such as ``h0_m=1.2e-7,0.1``, with as many numbers as `form` has."""
    found = []
    for pair in texts or ():
        name, _, values = pair.partition("=")
        try:
            numbers = tuple(float(value) for value in values.split(","))
        except ValueError:
            numbers = ()
        is_whole = len(numbers) == form.count(",") + 1 and all(map(isfinite, numbers))
        if not (is_whole and name.strip()):
            raise InputError(f"{option}: expected {form}, such as h0_m=1.2e-7, got {pair!r:.80}")
        found.append((name.strip(), numbers))
    return found


def _assignments(option: str, form: str) -> Callable[..., Any]:
    """Refuse what `_numbers` cannot read."""

    def check(_: typer.CallbackParam, value: list[str] | None) -> list[str] | None:
        _numbers(option, value, form)
        return value

    return check


def reduce(folder: Measured, as_json: AsJson = False) -> None:
    """Compute mu(F_N, V0, f) from the raw forces, and name the strokes that cannot be used."""
    from calibration.steps import REDUCED, reduce_folder

    found = reduce_folder(folder)
    rows = [{"stroke": one.number, **record(one)} for one in found.points]
    title = (
        f"{folder / REDUCED}: {len(found.used)} strokes to fit, {len(found.held_out)} held out, "
        f"{len(found.outliers)} not used"
    )
    show(title, rows if as_json else found.points, as_json)


def fit(
    folder: Measured,
    fix: Annotated[
        list[str] | None,
        typer.Option(
            help="Hold a parameter: NAME=VALUE; may be repeated.",
            callback=_assignments("--fix", "NAME=VALUE"),
        ),
    ] = None,
    prior: Annotated[
        list[str] | None,
        typer.Option(
            help="Prior: NAME=VALUE,SPREAD (0.1 for 10 %); may be repeated.",
            callback=_assignments("--prior", "NAME=VALUE,SPREAD"),
        ),
    ] = None,
    finger: Annotated[
        Path | None, option("fit.json of the same finger on another screen.", FileThere)
    ] = None,
    leaky_gap: Annotated[
        bool, typer.Option("--leaky-gap", help="Fit the resistivity of the gap.")
    ] = False,
    with_: Annotated[
        list[str] | None, option("Switch a term on.", tuple[TermName, ...], "--with")
    ] = None,
    without: Annotated[list[str] | None, option("Switch a term off.", tuple[TermName, ...])] = None,
    compare: Annotated[bool, typer.Option(help="Find which terms the strokes need.")] = True,
    as_json: AsJson = False,
) -> None:
    """Fit screen and finger, and report what the strokes determine.

    A parameter that they do not determine has no value, but the experiment that would give one.
    """
    from calibration.steps import FIT, fit_folder

    terms = dict.fromkeys(with_ or [], True) | dict.fromkeys(without or [], False)
    fixed = {name: value for name, (value,) in _numbers("--fix", fix, "NAME=VALUE")}
    priors: dict[str, tuple[float | None, float]] = {
        name: (value, spread)
        for name, (value, spread) in _numbers("--prior", prior, "NAME=VALUE,SPREAD")
    }
    found, needs = fit_folder(folder, fixed, priors, finger, leaky_gap, terms or None, compare)
    advice = [one.refusal() for one in found.undetermined]
    if as_json:
        document = {
            "estimates": [
                one.model_dump(mode="json", exclude={"advice"}) for one in found.estimates
            ],
            "advice": advice,
            "left_out": found.left_out,
            "theory": found.theory,
            **record(found, ("repeatability", "forms")),
            "terms": record(needs),
        }
        sys.stdout.write(json_text(document))
        return
    show(
        f"{folder / FIT}: {len(found.strokes)} strokes, which repeat within "
        f"{found.repeatability.log_mu:.1%}; theory {found.theory}",
        found.estimates,
        False,
    )
    left_out = [f"stroke {n} was not used: {why}" for n, why in sorted(found.left_out.items())]
    sys.stdout.writelines(f"{line}\n" for line in [*advice, *left_out])
    if found.forms:
        show("other forms of the model", found.forms, False)
    if needs:
        show("which terms the strokes need", needs, False)


def verify(
    folder: Measured,
    tolerance_thresholds: Annotated[
        float, option("Largest error, in just-noticeable differences (JND).", Positive)
    ] = 0.5,
    as_json: AsJson = False,
) -> None:
    """Verify the fit by strokes kept out of it; write profiles, report and archive.

    Exit code 1 if it fails.
    """
    from calibration.profile import SCREEN
    from calibration.steps import REPORT, verify_folder

    found, screen = verify_folder(folder, tolerance_thresholds)
    if as_json:
        sys.stdout.write(json_text(record(found)))
    else:
        written = "no profile" if screen is None else folder / SCREEN
        show_verdict(f"{found.verdict}: {written}, {folder / REPORT}", found)
    if found.failures:
        raise typer.Exit(1)


def show_verdict(title: str, found: Verification) -> None:
    """Show a verdict to people: what was tested, every stroke, and what failed or is missing."""
    show(title, found.groups, False)
    show("strokes kept out of the fit", found.strokes, False)
    sys.stdout.writelines(f"{line}\n" for line in found.failures)
    sys.stdout.writelines(f"not tested: {line}\n" for line in found.untested)
    sys.stdout.write(f"steadiness: {found.steadiness.text}\n")
