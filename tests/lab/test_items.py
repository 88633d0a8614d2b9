"""Items of a set are compared: pairs, triads, numbers and free sorting; their orders and tables."""

import io
from collections import Counter
from itertools import combinations, pairwise
from math import gcd

import numpy as np
import pytest
from scipy.stats import binom

from haptix import InputError, LimitError
from haptix.lab.analysis.results import analyse, report_html
from haptix.lab.analysis.scales import (
    covariate_rows,
    magnitude_differences,
    magnitude_rows,
    maps,
    scale_differences,
    similarity_rows,
)
from haptix.lab.experiment import (
    Experiment,
    Keys,
    Magnitudes,
    Pairs,
    Presentation,
    Question,
    SessionPlan,
    SimulatedObserver,
    Sorting,
    Touch,
    Triads,
)
from haptix.lab.experiment.orders import williams_square
from haptix.lab.experiment.recipe import ExperimentRecipe
from haptix.lab.experiment.session_plan import method_of
from tests.lab.ran import run_of

NAMES = ("denim", "silk", "sand", "glass", "wool")
LEVELS = [*range(len(NAMES))]
WAVE = np.sin(2 * np.pi * 120 * np.arange(240) / 48_000)
ITEMS = Presentation(
    lambda level: (10 + level) * WAVE, np.zeros(1), lambda level: 10 + level, items=NAMES
)


class Listening:
    """The device, and the peaks of what it has played."""

    def __init__(self, device):
        self.device, self.peaks = device, []

    def __getattr__(self, name):
        return getattr(self.device, name)

    def __enter__(self):
        self.device.__enter__()
        return self

    def __exit__(self, *why):
        return self.device.__exit__(*why)

    def write(self, drive):
        self.peaks.append(float(np.abs(drive).max()))
        return self.device.write(drive)


def ran(device, path, method, task, answer, **more):
    run = Experiment(
        method, more.pop("made", ITEMS), device, answer, path, task, plan=SessionPlan(),
        wait=lambda seconds: None, **more,
    )  # fmt: skip
    run.run()
    return run


def test_every_item_follows_every_other_one_equally_often_over_participants():
    of_people = [Magnitudes(LEVELS, 2, items=NAMES, first_row=2 * who)._order for who in range(5)]
    orders = [[at for (at,) in order] for order in of_people]
    rows = [order[5 * k :][:5] for order in orders for k in range(2)]
    assert all(sorted(row) == LEVELS for row in rows)
    follows = Counter(pair for row in rows for pair in pairwise(row))
    assert set(follows.values()) == {2} and len(follows) == 20


def items_by_magnitude(count, repeats):
    """A recipe whose items are known by their numbers."""
    return ExperimentRecipe(
        name="many", task="magnitude", method={"kind": "magnitudes", "repeats": repeats},
        stimulus={"quantity": "volts", "drive_hz": 120, "length_s": 0.01,
                  "signal": {"kind": "sine", "amplitude": 1.0, "frequency_hz": 120}},
        items=[{"name": f"item{k}"} for k in range(count)],
    )  # fmt: skip


@pytest.mark.parametrize("count", [2, 3, 4, 5, 8])
@pytest.mark.parametrize("repeats", [1, 2, 3, 4, 8, 10])
def test_orders_are_balanced_over_participants_and_differ_between_sessions(count, repeats):
    recipe = items_by_magnitude(count, repeats)
    rows = count * (1 + count % 2)  # of a square
    people = rows // gcd(rows, repeats)  # who use whole squares
    kept = set()
    for session in (1, 2):
        follows = Counter()
        for who in range(1, people + 1):
            order = [int(at) for (at,) in recipe.make_method(who, 5 * who, session)._order]
            parts = [order[k * count :][:count] for k in range(repeats)]
            assert all(sorted(part) == [*range(count)] for part in parts)
            follows.update(pair for part in parts for pair in pairwise(part))
            kept.add(tuple(order))
        assert len(follows) == count * (count - 1) and len(set(follows.values())) == 1
    if count * repeats >= 16:  # of fewer, orders that are drawn may be the same by chance
        assert len(kept) == 2 * people


def test_a_log_without_a_seed_of_squares_has_their_own_rows():
    before = {"method": "magnitudes", "levels": LEVELS, "repeats": 3, "first_row": 8}
    method, square = method_of(before), williams_square(len(LEVELS))
    assert isinstance(method, Magnitudes)
    assert method._order == [(at,) for k in (8, 9, 0) for at in square[k]]


def test_each_of_a_pair_is_first_equally_often():
    order = Pairs(LEVELS, 4, 7, NAMES)._order
    first = Counter(order)
    assert len(first) == 20 and set(first.values()) == {2}


@pytest.mark.parametrize(("count", "triads"), [(5, None), (9, 24), (12, 44)])
def test_triads_have_all_pairs_about_equally_often(count, triads):
    order = Triads([*range(count)], triads=triads, seed=3)._order
    pairs = Counter(frozenset(pair) for three in order for pair in combinations(three, 2))
    assert len(order) == (triads or 10) and len({frozenset(three) for three in order}) == len(order)
    assert len(pairs) == count * (count - 1) // 2
    assert max(pairs.values()) - min(pairs.values()) <= 2
    places = Counter(
        (frozenset(three), one, k)
        for three in Triads(LEVELS, 3, seed=1)._order
        for k, one in enumerate(three)
    )
    assert set(places.values()) == {1} and len(places) == 90


def test_the_presented_order_is_that_of_the_log(device, tmp_path):
    listening = Listening(device)
    run = ran(listening, tmp_path / "a.tsv", Triads(LEVELS, items=NAMES), "triads", lambda q: "2")
    peaks = np.reshape(listening.peaks, (-1, 3)) - 10
    for row, played in zip(run.log.rows, peaks, strict=True):
        levels = [float(row["level"]), *map(float, row["other_level"].split())]
        assert played == pytest.approx(levels, abs=0.05)
        assert (row["right"], row["is_right"], row["answer"]) == ("n/a", "n/a", "2")
    again = Triads(LEVELS, items=NAMES)
    assert ran(device, tmp_path / "a.tsv", again, "triads", lambda q: "2").is_over
    alike, together = again.alike()
    assert together.sum() == 2 * 30 and alike.sum() == 2 * 10


def test_a_group_is_a_whole_number_and_the_last_one_counts(device, tmp_path):
    seen = Counter()

    def answer(question):
        seen[question.level] += 1
        return str(int(question.level % 2) + 1 if seen[question.level] == 2 else 7)

    method = Sorting(LEVELS, 2, items=NAMES)
    ran(device, tmp_path / "a.tsv", method, "sorting", answer)
    assert method.groups() == {0: 1, 1: 2, 2: 1, 3: 2, 4: 1}
    with pytest.raises(InputError, match="whole number above 0"):
        ran(device, tmp_path / "b.tsv", Sorting(LEVELS), "sorting", lambda question: "1.5")
    keys = Keys(source=io.StringIO("0\n2.5\nx\n3\n"), sink=(said := io.StringIO()))
    group = Question(0, (), 1.0, "", asks="Which group?", takes_whole_numbers=True)
    assert keys(group) == "3" and said.getvalue().count("whole number above 0") == 3


def test_an_item_above_the_ceiling_is_refused_and_not_lowered(device, tmp_path):
    with pytest.raises(LimitError, match="wool: reaches 14 V"):
        ran(device, tmp_path / "a.tsv", Magnitudes(LEVELS, 1, items=NAMES), "magnitude",
            SimulatedObserver(0.0), ceiling_v=13.0)  # fmt: skip


FABRICS = """
name = "fabrics"
task = "{task}"
[method]
kind = "{kind}"
repeats = 1
[stimulus]
signal = {{ kind = "sine", amplitude = 0.05, frequency_hz = 60.0, offset = 0.06 }}
length_s = 0.01
[[items]]
name = "slow"
[[items]]
name = "fast"
set = {{ "stimulus.signal.frequency_hz" = 200.0 }}
[[items]]
name = "weave"
[items.set."stimulus.signal"]
kind = "material"
of = {{ kind = "grating", period_mm = 2.0, low = 0.05, high = 0.15, target = "contrast" }}
speed = 50.0
"""


@pytest.mark.usefixtures("own_cache")
def test_signals_and_materials_of_a_recipe_are_compared(device, tmp_path):
    recipe = tmp_path / "fabrics.toml"
    recipe.write_text(FABRICS.format(task="triads", kind="triads"))
    plan = ExperimentRecipe.load(recipe)
    made = plan.presentation(device.capabilities.sample_rate_hz)
    assert [*made.items] == ["slow", "fast", "weave"]
    drives = [made.target(k) for k in range(3)]
    assert all(np.abs(a - b).max() > 1 for a, b in combinations(drives, 2))
    log = tmp_path / "a.tsv"
    plan.experiment(device, SimulatedObserver(0.0), log, wait=lambda seconds: None).run()
    tables = analyse(log).tables
    assert {row["item"] for row in tables["similarities"]} == {"slow", "fast"}
    assert tables["trials"][0]["third"] in ("slow", "fast", "weave")


def test_a_recipe_of_items_refuses_what_has_no_sense_with_them(tmp_path):
    good = FABRICS.format(task="pairs", kind="pairs")
    for more, words in (
        ("catch = { share = 0.2, level = 1.0 }\n", "catch: expected none"),
        ('conditions = [{ name = "a" }, { name = "b" }]\n', "conditions: expected none"),
        ('task = "2ifc"\n', "items: expected a task"),
    ):
        text = more + (good.replace('task = "pairs"', "") if more.startswith("task") else good)
        (tmp_path / "a.toml").write_text(text)
        with pytest.raises(InputError, match=words):
            ExperimentRecipe.load(tmp_path / "a.toml")
    for place in ("amplitude", "method.repeats"):  # which nothing would read
        (tmp_path / "a.toml").write_text(good.replace("stimulus.signal.frequency_hz", place))
        with pytest.raises(InputError, match=rf"items\.fast\.set\.{place}: .*with stimulus,"):
            ExperimentRecipe.load(tmp_path / "a.toml").make_method()
    with pytest.raises(InputError, match="numbers of the items"):
        Pairs([1.0, 2.0], items=("a", "b"))


def numbers(draw, people, values, repeats=2, scatter=0.3, differ=0.2):
    """Runs of people with a scale of their own, whose values differ."""
    runs = []
    for who in range(people):
        own = draw.standard_normal() + values + differ * draw.standard_normal(len(values))
        method = Magnitudes([*range(len(values))], repeats, items=NAMES[: len(values)])
        while not method.is_done:
            log = own[int(method.level)] + scatter * draw.standard_normal()
            method.update(float(np.exp(log)))
        runs.append(run_of(method, str(who)))
    return runs


def test_differences_of_numbers_are_those_of_paired_t_tests(rng):
    from scipy.stats import ttest_rel

    runs = numbers(rng, 8, np.array([0.0, 0.5, 0.6]))
    rows = magnitude_differences(runs)
    table = np.array(
        [[np.mean([np.log(n) for at, n in run.method.answers if at == k]) for k in range(3)]
         for run in runs]
    )  # fmt: skip
    for row, (i, k) in zip(rows, combinations(range(3), 2), strict=True):
        test = ttest_rel(table[:, i], table[:, k])
        assert (row["item"], row["other"]) == (NAMES[i], NAMES[k])
        assert row["p"] == pytest.approx(test.pvalue)
        assert (row["low"], row["high"]) == pytest.approx([*test.confidence_interval()])
    ordered = sorted(rows, key=lambda row: row["p"])
    wanted = np.maximum.accumulate([row["p"] * (3 - k) for k, row in enumerate(ordered)])
    assert [row["p_holm"] for row in ordered] == pytest.approx(np.minimum(wanted, 1.0).tolist())


def test_intervals_over_the_set_hold_the_values(rng):
    """200 studies: of a share of 0.95 the standard error is 0.015 (0.009 for the three items)."""
    values, held, apart = np.array([0.0, 0.3, 1.0]), [], []
    for _ in range(200):
        runs = numbers(rng, 6, values)
        rows = [row for row in magnitude_rows(runs) if row["participant"] == "all"]
        middle = np.log([row["mean"] for row in rows]).mean() - values.mean()
        held += [
            row["low"] <= np.exp(middle + value) <= row["high"]
            for row, value in zip(rows, values, strict=True)
        ]
        apart += [row["low"] <= -0.3 <= row["high"] for row in magnitude_differences(runs)[:1]]
    assert 0.92 <= np.mean(held) <= 0.98
    assert 0.92 <= np.mean(apart) <= 0.98


def test_differences_of_a_scale_have_the_errors_of_the_likelihood(rng):
    """Two items: the difference is the log odds, with the variance 1 / wins + 1 / losses."""
    method = Pairs([0, 1], 400, items=NAMES[:2])
    while not method.is_done:
        method.update(rng.random() < 1 / (1 + np.exp(method.level - method.other_levels[0])))
    (row,) = scale_differences([run_of(method)])
    wins = method.wins()
    odds = np.log((wins[0, 1] + 0.5) / (wins[1, 0] + 0.5))
    half = 1.96 * np.sqrt(1 / wins[0, 1] + 1 / wins[1, 0])
    assert row["difference_logit"] == pytest.approx(odds, abs=1e-6)
    assert row["high"] - row["low"] == pytest.approx(2 * half, rel=0.01)


def test_a_map_of_sorted_items_has_their_places(rng):
    """Eight items in a plane, of which 30 people call the one furthest from the others unlike."""
    from scipy.stats import spearmanr

    places = rng.normal(size=(8, 2)) * (1.0, 0.6)
    apart = np.linalg.norm(places[:, None] - places[None], axis=-1)
    runs = []
    for who in range(30):
        method = Triads([*range(8)], seed=who, triads=40)
        while not method.is_done:
            three = [int(one) for one in (method.level, *method.other_levels)]
            felt = apart[np.ix_(three, three)] + 0.5 * rng.standard_normal((3, 3))
            method.update(1 + int(np.argmax((felt + felt.T).sum(0))))
        runs.append(run_of(method, str(who)))
    at, fit = maps(runs)
    found = np.array([[row["x"], row["y"]] for row in at])
    between = np.linalg.norm(found[:, None] - found[None], axis=-1)
    upper = np.triu_indices(8, 1)
    assert spearmanr(between[upper], apart[upper]).statistic > 0.9
    assert [row["dimensions"] for row in fit] == [1, 2, 3]
    assert fit[1]["stress"] < 0.5 * fit[1]["stress_by_chance"]
    assert fit[0]["stress"] > 1.5 * fit[1]["stress"]
    rows = [row for row in similarity_rows(runs) if row["participant"] == "all"]
    shares = [row["share"] for row in rows]
    assert np.corrcoef(shares, apart[upper])[0, 1] < -0.8


@pytest.mark.parametrize("people", [5, 8, 12])
def test_the_share_of_people_who_sort_two_together_is_held_and_no_wider(people):
    """Coverage of the 95 % interval, exact by the binomial distribution, over all true shares."""
    intervals = []
    for together in range(people + 1):
        runs = []
        for who in range(people):
            method = Sorting([0, 1, 2], 1)
            group = {0: 1, 1: 1 if who < together else 2, 2: 3}
            while not method.is_done:
                method.update(group[int(method.level)])
            runs.append(run_of(method, str(who)))
        row = next(row for row in similarity_rows(runs) if row["participant"] == "all")
        assert row["share"] == together / people
        intervals.append((row["low"], row["high"]))
    low, high = np.array(intervals).T
    true = np.linspace(0.05, 0.95, 181)[:, None]
    chance = binom.pmf(np.arange(people + 1), people, true)
    held = (chance * ((low <= true) & (true <= high))).sum(1)
    assert 0.945 <= held.mean() <= 0.965
    assert held.min() > 0.89  # of so few counts each interval leaves some shares out


def test_an_effect_of_force_on_numbers_is_found_and_stated(device, tmp_path, rng):
    forces = iter(rng.uniform(0.3, 0.7, 200).tolist())
    felt = []

    def touch():
        felt.append(next(forces))
        return Touch(felt[-1], 80.0)

    def answer(question):
        felt_n = felt[-1]
        return f"{10 * (1 + question.level) * felt_n**1.5 * np.exp(0.05 * rng.standard_normal())}"

    log = tmp_path / "a.tsv"
    ran(device, log, Magnitudes(LEVELS, 6, items=NAMES), "magnitude", answer, touch=touch,
        normal_force_n=(0.2, 0.65))  # fmt: skip
    analysis = analyse(log)
    effects = analysis.tables["covariates"]
    force = next(row for row in effects if row["covariate"] == "normal_force_n")
    assert force["low"] < 1.5 < force["high"] and force["high"] - force["low"] < 0.4
    trials = analysis.tables["trials"]
    assert len(trials) == 30 and all(0.2 <= row["normal_force_n"] <= 0.65 for row in trials)
    assert covariate_rows([]) == []
    assert "denim" in report_html(analysis, "fabrics")
