"""Analysis of logs or of a BIDS study: thresholds, scales, tables and a report."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import isnan
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from haptix.base.checks import Array
from haptix.base.errors import FileFormatError, MissingExtraError, from_extra
from haptix.base.files import digest, json_text, write_folder
from haptix.base.report import page, paragraph, picture, table
from haptix.base.version import __version__
from haptix.lab.analysis.foreign import REPORT, TrialColumns, advice, is_table
from haptix.lab.analysis.preregistration import NAME, Preregistration
from haptix.lab.analysis.runs import (
    ALL,
    LEAST_PARTICIPANTS,
    OF_GROUP,
    Row,
    RunOfMethod,
    condition_of,
    grouped,
    half_interval,
    holm,
    known,
    runs_of,
    words,
)
from haptix.lab.analysis.scales import (
    covariate_rows,
    magnitude_differences,
    magnitude_rows,
    maps,
    pair_rows,
    scale_differences,
    scale_rows,
    similarity_rows,
    trial_rows,
)
from haptix.lab.analysis.study import BIDS_VERSION
from haptix.lab.experiment import Magnitudes, Pairs
from haptix.lab.experiment.comparisons import Comparison, Similarities
from haptix.lab.experiment.methods import ThresholdMethod
from haptix.lab.experiment.psychometric import (
    Group,
    counted,
    function_named,
    group,
    group_of_likelihoods,
)
from haptix.lab.experiment.session_plan import estimate_of
from haptix.lab.experiment.trial_log import is_log, read_sessions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TRIALS = "trials"
"""Table of single trials, which is written, and not shown."""
MOST_PICTURES = 100
"""Of runs; those after them are in the tables alone."""

_SCALE = ("scale_logit", "low_logit", "high_logit")
_MEAN = ("mean", "low", "high")
_INTERVAL = 0.95
_EXACT = 1e-6  # spread of numbers without scatter


def _foreign_runs(source: Path, columns: TrialColumns) -> Iterator[RunOfMethod]:
    shared = columns.model_dump(include={"task", "level", "level_unit"})
    for session, condition, method in columns.sessions(source):
        estimate = estimate_of(method, session.rows, columns.task, condition)
        yield RunOfMethod(
            session, condition, digest(shared)[:8], method, estimate, session.rows, {},
            session.remarks,
        )  # fmt: skip


Likelihood = tuple[Array, Array]
"""Thresholds, and the logarithm of the likelihood of each."""


def over_participants(
    rows: Sequence[Row], column: str, likelihoods: Sequence[Likelihood | None] = ()
) -> tuple[list[Row], list[Row]]:
    """Return the mean of each condition over participants, and differences of two conditions.

    Each task has a hierarchical model: `group_of_likelihoods` of thresholds, in which those above
    or below all levels have their part, and `group` of other values. A participant without a
    value, or excluded, is left out, and named with the reason. `p_holm` is p corrected for the
    number of pairs of the task (Holm, Scand. J. Stat. 6, 65 (1979)).

    Parameters
    ----------
    rows : sequence of dict
        A row for each participant, session and condition.
    column : str
        "threshold_db" with its interval, or "exponent" with its spread.
    likelihoods : sequence of (ndarray, ndarray), optional
        Of each row's threshold.
    """
    means, differences = [], []
    of_rows = dict(zip(map(id, rows), likelihoods, strict=bool(likelihoods)))
    for task, of_task in grouped(rows, lambda row: row["task"]).items():
        conditions = grouped(of_task, condition_of)
        known = {
            place: {
                who: kept
                for who, those in grouped(members, lambda row: str(row["participant"])).items()
                if (kept := [row for row in those if not _left_out(row, column, of_rows)])
            }
            for place, members in conditions.items()
        }
        places = [place for place, people in known.items() if people]
        factors = dict(zip(places, np.eye(len(places)), strict=True))
        fitted = None
        if max(map(len, known.values())) >= LEAST_PARTICIPANTS:
            fitted = _fitted([known[place] for place in places], column, of_rows)
        for place, members in conditions.items():
            people, low, high, between, mean = known[place], None, None, None, None
            if fitted is not None and len(people) >= LEAST_PARTICIPANTS:
                mean, low, high, _ = fitted.contrast(factors[place])
                between = fitted.between
            elif people:
                values = [row[column] for those in people.values() for row in those]
                mean = None if None in values else float(np.mean(values))
            counts = {
                "participants": len(people),
                "beyond_levels": sum(
                    all(row[column] is None for row in p) for p in people.values()
                ),
                "left_out": _why_left_out(members, column, of_rows),
            }
            found = {column: mean, "between": between, "low": low, "high": high}
            means.append(dict(zip(OF_GROUP, place, strict=True)) | counts | found)
        pairs: list[Row] = []
        for first, second in combinations(conditions, 2):
            both = known[first].keys() & known[second].keys()
            if first[1] == second[1] or len(both) < LEAST_PARTICIPANTS or fitted is None:
                continue
            mean, low, high, p = fitted.contrast(factors[second] - factors[first])
            names = {"task": task, "condition": second[1], "minus": first[1]}
            found = {"participants": len(both), "difference_db": mean, "low": low, "high": high}
            pairs.append(names | found | {"p": p, "p_holm": None})
        holm(pairs)
        differences += pairs
    return means, differences


def _left_out(row: Row, column: str, likelihoods: Mapping[int, Likelihood | None]) -> str:
    """Return why a row is in no mean; empty where it is."""
    if row.get("excluded"):
        return str(row["excluded"])
    if likelihoods.get(id(row)) is None and row[column] is None:
        return str(row.get("warnings") or f"no {column}")
    return ""


def _why_left_out(
    rows: Sequence[Row], column: str, likelihoods: Mapping[int, Likelihood | None]
) -> str:
    whys = [(row, _left_out(row, column, likelihoods)) for row in rows]
    return "; ".join(f"{row['participant']} {row['session']}: {why}" for row, why in whys if why)


def _fitted(
    places: Sequence[Mapping[str, Sequence[Row]]],
    column: str,
    likelihoods: Mapping[int, Likelihood | None],
) -> Group:
    """Return the model of all conditions; the sessions of a participant are taken together."""
    members = [(who, k, rows) for k, people in enumerate(places) for who, rows in people.items()]
    names, condition = [who for who, _, _ in members], [k for _, k, _ in members]
    if column == "threshold_db":
        of_all = [[likelihoods[id(row)] for row in rows] for _, _, rows in members]
        return group_of_likelihoods([_together(one) for one in of_all], names, condition)
    values, spreads = [], []
    for _, _, rows in members:
        precision = np.array([row["exponent_spread"] or _EXACT for row in rows]) ** -2.0
        values.append(np.array([row[column] for row in rows]) @ precision / precision.sum())
        spreads.append(precision.sum() ** -0.5)
    return group(np.array(values), np.array(spreads), names, condition)


def _together(likelihoods: Sequence[Likelihood | None]) -> Likelihood:
    """Multiply the likelihoods of some sessions."""
    known = [one for one in likelihoods if one is not None]
    if len(known) == 1:
        return known[0]
    at = np.unique(np.concatenate([levels for levels, _ in known]))
    logs = np.sum([np.interp(at, *one) for one in known], 0)
    return at, logs - logs.max()


@dataclass(frozen=True)
class Analysis:
    """Results of some sessions.

    Parameters
    ----------
    tables : dict of str to list of dict
        "thresholds", "scales", "pairs", "magnitudes", "exponents", "similarities" and "covariates"
        of each participant, as the tasks have them; "group" and "exponents-group" over
        participants; "differences" of conditions within participants; "scale-differences" and
        "magnitude-differences" of items or levels; "map" and "map-fit"; "trials" of comparisons.
    notes : tuple of str
        Mixed or missing data.
    runs : tuple of RunOfMethod
        Data of the tables, for pictures.
    """

    tables: dict[str, list[Row]]
    notes: tuple[str, ...]
    runs: tuple[RunOfMethod, ...]


def analyse(
    source: str | Path,
    preregistration: str | Path | None = None,
    columns: TrialColumns | None = None,
) -> Analysis:
    """Analyse a log, a folder of logs, a study in the form of BIDS, or tables of other programs.

    Thresholds are those that the experiment stated: none where the answers could be guesses, or
    where they lie beyond the levels; the means count them as above or below. Sessions that their
    plan excludes are in the tables, but not in the means. A `preregistration`, by default
    ``code/preregistration.json`` of a study, is compared with the sessions, and the notes say in
    what they differ.

    Parameters
    ----------
    source : path
        Data to analyse.
    preregistration : path, optional
        File of `haptix.lab.analysis.preregistration.Preregistration`.
    columns : TrialColumns, optional
        Which column is what, where another program wrote the tables.

    Raises
    ------
    FileFormatError
        If a file is no log, or was changed.
    InputError
        If there is none.
    """
    stated: list[str] = []
    if columns is not None:
        runs = [*_foreign_runs(Path(source), columns)]
        if preregistration:
            stated = [
                f"not compared with {preregistration}: tables of other programs do not have the "
                "design that was run"
            ]
    else:
        if is_table(Path(source)) and not is_log(Path(source)):
            raise FileFormatError(advice(Path(source)))
        sessions = read_sessions(source)
        runs = [run for session in sessions for run in runs_of(session)]
        stated_at = Path(preregistration or Path(source) / "code" / NAME)
        if preregistration or stated_at.exists():
            known = Preregistration.load(stated_at)
            stated = [f"not as preregistered: {one}" for one in known.deviations([*sessions])]
            stated = stated or [
                f"as preregistered on {known.written_on} ({known.content_hash[:12]})"
            ]
    pairs = [run for run in runs if isinstance(run.method, Pairs)]
    numbers = [run for run in runs if isinstance(run.method, Magnitudes)]
    alike = [run for run in runs if isinstance(run.method, Similarities)]
    tables: dict[str, list[Row]] = {}
    if with_threshold := [run for run in runs if not isinstance(run.method, Comparison)]:
        rows = _filled(map(_threshold_row, with_threshold))
        tables["thresholds"] = rows
        likelihoods = [run.estimate.likelihood for run in with_threshold]
        tables["group"], tables["differences"] = over_participants(
            rows, "threshold_db", likelihoods
        )
    if pairs:
        tables["scales"], tables["pairs"] = scale_rows(pairs), pair_rows(pairs)
        tables["scale-differences"] = scale_differences(pairs)
    if numbers:
        tables["magnitudes"] = magnitude_rows(numbers)
        tables["magnitude-differences"] = magnitude_differences(numbers)
        tables["covariates"] = covariate_rows(numbers)
    if of_levels := [run for run in numbers if not getattr(run.method, "items", ())]:
        tables["exponents"] = _filled(map(_exponent_row, of_levels))
        tables["exponents-group"], _ = over_participants(tables["exponents"], "exponent")
    if alike:
        tables["similarities"] = similarity_rows(alike)
        try:
            tables["map"], tables["map-fit"] = maps(alike)
        except MissingExtraError as error:
            stated.append(f"without a map: {error}")
    if compared := [run for run in runs if isinstance(run.method, Comparison)]:
        tables[TRIALS] = trial_rows(compared)
    return Analysis(
        {name: rows for name, rows in tables.items() if rows}, (*_notes(runs), *stated), (*runs,)
    )


def _threshold_row(run: RunOfMethod) -> Row:
    estimate = run.estimate.record()
    estimate.pop("guess", None)
    warnings = "; ".join(estimate.pop("warnings"))
    return {**run.place, "trials": len(run.rows), **estimate, **run.summary, "warnings": warnings}


def _exponent_row(run: RunOfMethod) -> Row:
    assert isinstance(run.method, Magnitudes)
    others = run.estimate.others
    values = {name: known(others.get(name)) for name in ("exponent", "exponent_spread")}
    exponent, spread = values.values()
    if exponent is not None and spread is not None and len(run.method.answers) > 2:
        half = float(half_interval(spread, len(run.method.answers) - 2))
        values |= {"low": exponent - half, "high": exponent + half}
    warnings = {"warnings": "; ".join(run.estimate.warnings)}
    return {**run.place, "trials": len(run.rows), **values, **run.summary, **warnings}


def _filled(rows: Iterable[Row]) -> list[Row]:
    """Give all rows the same columns; the reasons come last."""
    listed = list(rows)
    names = dict.fromkeys(name for row in listed for name in row)
    last = [name for name in ("excluded", "warnings") if name in names]
    order = [*(name for name in names if name not in last), *last]
    return [{name: row.get(name) for name in order} for row in listed]


def _notes(runs: Sequence[RunOfMethod]) -> tuple[str, ...]:
    notes = [*dict.fromkeys(remark for run in runs for remark in run.remarks)]
    conditions = grouped(runs, lambda run: (run.session.task, run.condition))
    for (task, condition), alike in conditions.items():
        counts = Counter(run.experiment for run in alike)
        if len(counts) > 1:
            what = words(task, condition) or "the logs"
            parts = ", ".join(f"{count} of {name}" for name, count in counts.items())
            notes.append(
                f"{what}: the sessions are of different experiments, whose means stay apart: "
                f"{parts}"
            )
    with_one = (run for run in runs if not isinstance(run.method, Comparison))
    if without := [run for run in with_one if isnan(run.estimate.threshold)]:
        notes.append(
            f"{len(without)} of {len(runs)} runs have no threshold; their rows say why, and the "
            "means count them as above or below the end that is known"
        )
    if excluded := dict.fromkeys(run.session.name for run in runs if "excluded" in run.summary):
        notes.append(f"excluded by the rules of their plan: {', '.join(excluded)}")
    return tuple(notes)


def report_html(analysis: Analysis, title: str) -> str:
    """Return the page; without the extra ``stimuli`` it states that it has no pictures."""
    parts = [paragraph(line) for line in (f"haptix {__version__}", *analysis.notes)]
    parts += [table(name, rows) for name, rows in analysis.tables.items() if name != TRIALS]
    drawn = [run for run in analysis.runs if run.rows and not isinstance(run.method, Similarities)]
    try:
        parts += [picture(name, figure) for name, figure in _of_groups(analysis)]
        for run in drawn[:MOST_PICTURES]:
            name = words(run.session.name, run.session.task, run.condition)
            parts.append(picture(name, _of_run(run)))
    except MissingExtraError as error:
        parts.append(paragraph(f"Without pictures: {error}"))
    if len(drawn) > MOST_PICTURES:
        parts.append(paragraph(f"{len(drawn) - MOST_PICTURES} more runs are in the tables alone."))
    return page(title, parts)


def write_analysis(
    analysis: Analysis, out: str | Path, title: str, of_study: bool = False
) -> list[Path]:
    """Write each table as NAME.tsv, and the report; those of an earlier analysis are replaced.

    Parameters
    ----------
    analysis : Analysis
        Content to write.
    out : path
        Folder.
    title : str
        Of the report.
    of_study : bool
        Describe the folder as a data set of its own that was derived from another (BIDS).
    """
    files: dict[str, str] = {}
    if of_study:
        about = {
            "Name": f"Analysis of {title}",
            "BIDSVersion": BIDS_VERSION,
            "DatasetType": "derivative",
            "GeneratedBy": [{"Name": "haptix", "Version": __version__}],
        }
        files["dataset_description.json"] = json_text(about)
    for name, rows in analysis.tables.items():
        lines = [list(rows[0]), *([_cell(value) for value in row.values()] for row in rows)]
        files[f"{name}.tsv"] = "".join("\t".join(line) + "\n" for line in lines)
    files[REPORT] = report_html(analysis, title)
    return write_folder(Path(out), files)


def _cell(value: Any) -> str:
    """Text of a cell as BIDS has it; the shortest number that reads the same."""
    return "n/a" if value in (None, "") else " ".join(str(value).split())


def _axes(count: int) -> tuple[Figure, Sequence[Any]]:
    with from_extra("stimuli"):
        from matplotlib.figure import Figure

    figure = Figure(figsize=(4.2 * count, 3.2), layout="constrained")
    return figure, [figure.add_subplot(1, count, k + 1) for k in range(count)]


def _of_groups(analysis: Analysis) -> Iterator[tuple[str, Figure]]:
    """Thresholds of all participants; scales of all."""
    rows = analysis.tables.get("thresholds", [])
    known = grouped((row for row in rows if row["threshold_db"] is not None), condition_of)
    for row_of_group in analysis.tables.get("group", []):
        members = known.get(condition_of(row_of_group), [])
        if len(members) < 2:
            continue
        figure, (axes,) = _axes(1)
        names = [row["participant"] for row in members]
        at, low, high = _columns(members, ("threshold_db", "low_db", "high_db"))
        axes.errorbar(at, names, xerr=[at - low, high - at], fmt="o", capsize=3)
        if row_of_group["low"] is not None:
            axes.axvspan(row_of_group["low"], row_of_group["high"], alpha=0.2)
            axes.axvline(row_of_group["threshold_db"])
        axes.set(xlabel="threshold [dB] with 95 % intervals; the band: the mean")
        yield words("thresholds", row_of_group["task"], row_of_group["condition"]), figure
    for name, columns in (("scales", _SCALE), ("magnitudes", _MEAN)):
        listed = analysis.tables.get(name, [])
        for (_, condition, _), members in grouped(listed, condition_of).items():
            people = grouped(members, itemgetter("participant", "session"))
            if len(people) < 2:  # it has the picture of its run
                continue
            figure, (axes,) = _axes(1)
            for (who, _), line in people.items():
                _draw_levels(axes, line, columns, linewidth=3 if who == ALL else 1, label=who)
            axes.legend(fontsize="small")
            yield words(name, condition), figure
    for (_, condition, _), members in grouped(analysis.tables.get("map", []), condition_of).items():
        figure, (axes,) = _axes(1)
        for row in members:
            axes.plot(row["x"], row["y"], "o", color="0.4")
            axes.annotate(str(row.get("item", row.get("level_db"))), (row["x"], row["y"]))
        axes.set(aspect="equal", xlabel="near: called alike; the axes have no unit")
        yield words("map", condition), figure


def _columns(rows: Sequence[Row], names: tuple[str, ...]) -> Array:
    return np.array([[row[name] for name in names] for row in rows], dtype=float).T


def _draw_levels(axes: Any, rows: Sequence[Row], columns: tuple[str, str, str], **how: Any) -> None:
    """Scale values or geometric means against the level, with intervals where there are some."""
    y, low, high = _columns(rows, columns)
    bounds = np.nan_to_num([y - low, high - y])
    has_items = "item" in rows[0]
    at = [row["item" if has_items else "level_db"] for row in rows]
    axes.errorbar(at, y, bounds, fmt="o" if has_items else "o-", capsize=3, **how)
    label = "Bradley-Terry value [logit]" if columns is _SCALE else "geometric mean"
    if columns is not _SCALE:
        axes.set_yscale("log")
        for set_formatter in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
            set_formatter("{x:g}")
    what = "item" if has_items else "level [dB]"
    axes.set(xlabel=f"{what}; bars: 95 % intervals", ylabel=label)
    if has_items:
        axes.tick_params(axis="x", rotation=60)


def _of_run(run: RunOfMethod) -> Figure:
    """The scale; the numbers and their means; or levels trial by trial, and the share right."""
    if isinstance(run.method, Pairs | Magnitudes):
        figure, (axes,) = _axes(1)
        if isinstance(run.method, Pairs):
            _draw_levels(axes, scale_rows([run]), _SCALE)
        else:
            axes.plot(*np.array(run.method.answers).T, ".", color="0.6")
            _draw_levels(axes, magnitude_rows([run]), _MEAN)
        return figure
    levels = np.array([float(row["level"]) for row in run.rows])
    trials = np.array([int(row["trial"]) for row in run.rows])
    right = np.array([row["is_right"] == "true" for row in run.rows])
    figure, (walk, shares) = _axes(2)
    walk.plot(trials, levels, "-", color="0.7")
    walk.plot(trials[right], levels[right], "o", markersize=4, label="right")
    walk.plot(trials[~right], levels[~right], "x", markersize=5, label="wrong")
    walk.set(xlabel="trial", ylabel="level [dB]")
    walk.legend(fontsize="small")
    _draw_shares(shares, run, [*zip(levels.tolist(), right.tolist(), strict=True)])
    return figure


def _draw_shares(axes: Any, run: RunOfMethod, answers: list[tuple[float, bool]]) -> None:
    """Share right at each level with Wilson's interval, and the function."""
    from scipy.stats import binomtest

    at, right, wrong = counted(answers)
    total = right + wrong
    tests = [binomtest(int(k), int(n)) for k, n in zip(right, total, strict=True)]
    low, high = np.array([test.proportion_ci(_INTERVAL, "wilson") for test in tests]).T
    share = right / total
    bounds = np.clip([share - low, high - share], 0, None)
    axes.errorbar(at, share, bounds, fmt="none", color="0.6")
    axes.scatter(at, share, 10 + 4 * total)
    estimate, method = run.estimate, run.method
    if not isnan(estimate.threshold):
        axes.axvspan(estimate.low, estimate.high, alpha=0.2, lw=0)
        axes.axvline(estimate.threshold)
        if isinstance(method, ThresholdMethod):
            x, others = np.linspace(at.min(), at.max(), 200), estimate.others
            guess = others.get("guess", method.guess_share)
            curve = function_named(method.function)
            axes.plot(x, curve(x, estimate.threshold, others["slope"], guess, others["lapse"]))
    axes.set(xlabel="level [dB]", ylabel="share right", ylim=(-0.05, 1.05))
