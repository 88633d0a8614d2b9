"""The hierarchical model: against simulated groups, ordinary statistics, and dense matrices."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal, ttest_1samp, ttest_rel

from haptix.lab.experiment.psychometric import group, group_of_likelihoods

A, B = np.array([1.0, 0.0]), np.array([0.0, 1.0])
RUNS = 30


def people(count, shared, own, spread, seed):
    """Values of participants in two conditions, 2 apart, and their spreads."""
    draw = np.random.default_rng([seed, count])
    spreads = spread * np.exp(0.3 * draw.standard_normal((count, 2)))
    value = np.array([22.0, 24.0]) + shared * draw.standard_normal((count, 1))
    value = value + own * draw.standard_normal((count, 2))
    return value + spreads * draw.standard_normal((count, 2)), spreads


def of(value, spread):
    names = [str(k) for k in range(len(value)) for _ in (0, 1)]
    return group(value.ravel(), spread.ravel(), names, [0, 1] * len(value))


@pytest.mark.parametrize("count", [3, 8])
@pytest.mark.parametrize(("shared", "own", "spread"), [(3.0, 1.0, 1.0), (1.0, 1.0, 0.3)])
def test_intervals_hold_the_truth_of_simulated_groups(count, shared, own, spread):
    held = np.zeros(2)
    for seed in range(RUNS):
        found = of(*people(count, shared, own, spread, seed))
        for k, (factors, truth) in enumerate(((A, 22.0), (B - A, 2.0))):
            _, low, high, _ = found.contrast(factors)
            held[k] += low < truth < high
    # Of 95 %, three errors of so few runs below; wider where few participants tell nothing.
    assert (held / RUNS > 0.95 - 3 * np.sqrt(0.95 * 0.05 / RUNS)).all()


def test_exact_values_of_many_give_the_intervals_of_student():
    value, spread = people(40, 3.0, 1.0, 1e-6, 1)
    found = of(value, spread)
    mean, low, high, _ = found.contrast(B - A)
    student = ttest_rel(value[:, 1], value[:, 0]).confidence_interval()
    # The prior counts as less than one of forty participants.
    assert mean == pytest.approx(np.mean(value[:, 1] - value[:, 0]), abs=1e-6)
    assert high - low == pytest.approx(student.high - student.low, rel=0.05)
    _, low, high, _ = found.contrast(A)
    student = ttest_1samp(value[:, 0], 0).confidence_interval()
    assert high - low == pytest.approx(student.high - student.low, rel=0.05)
    assert found.between == pytest.approx(value.std(0, ddof=1).mean(), rel=0.1)


def test_it_is_that_of_dense_matrices():
    """One pair of sizes against the whole covariance, and its likelihood over flat means."""
    value, spread = people(4, 2.0, 1.0, 0.7, 3)
    found = of(value[:, :], spread)
    y, design = value.ravel(), np.tile(np.eye(2), (4, 1))
    scale = np.sqrt(((value - value.mean(0)) ** 2).sum() / 6)
    sizes = scale * np.concatenate([[0.0], np.geomspace(0.05, 5.0, 16)])
    prior = np.gradient(sizes) / (1 + (sizes / scale) ** 2)
    logs = []
    for k, (shared, own) in enumerate((s, o) for s in sizes for o in sizes):
        full = np.kron(np.eye(4), np.full((2, 2), shared**2)) + np.diag(
            own**2 + spread.ravel() ** 2
        )
        inverse = design.T @ np.linalg.solve(full, design)
        mean = np.linalg.solve(inverse, design.T @ np.linalg.solve(full, y))
        assert found.mean[k] == pytest.approx(mean, abs=1e-7)
        likelihood = multivariate_normal(design @ mean, full).logpdf(y)
        weight = np.outer(prior, prior).ravel()[k]
        logs.append(likelihood - 0.5 * np.linalg.slogdet(inverse)[1] + np.log(weight))
    weight = np.exp(np.array(logs) - max(logs))
    assert found.weight == pytest.approx(weight / weight.sum(), abs=1e-9)


def normal_likelihoods(value, spread):
    grid = np.linspace(0.0, 50.0, 400)
    pairs = zip(value.ravel(), spread.ravel(), strict=True)
    return [(grid, -0.5 * (grid - at) ** 2 / sd**2) for at, sd in pairs]


def test_likelihoods_that_are_normal_give_the_same():
    value, spread = people(8, 3.0, 1.0, 1.0, 2)
    names, condition = [str(k) for k in range(8) for _ in (0, 1)], [0, 1] * 8
    found = group_of_likelihoods(normal_likelihoods(value, spread), names, condition)
    plain = of(value, spread)
    for factors in (A, B, B - A):
        # The widths of the priors differ: they are of the scatter, its own errors taken off or not.
        assert found.contrast(factors)[:3] == pytest.approx(plain.contrast(factors)[:3], abs=0.1)


def test_those_above_the_levels_raise_the_mean():
    """A quarter above 24: a Monte-Carlo study of the mean, and of the mean without them."""
    held, off, without = 0, [], []
    for seed in range(RUNS):
        value, spread = people(12, 3.0, 0.5, 0.5, seed)
        value, spread = value[:, :1], spread[:, :1]
        known = normal_likelihoods(value, spread)
        above = (value > 24.0).ravel()
        # Whose threshold lies above is right by chance at all levels up to there.
        felt = [
            (grid, np.where(grid > 24.0, 0.0, -0.5 * (grid - 24.0) ** 2 / 0.5**2))
            if high
            else (grid, logs)
            for (grid, logs), high in zip(known, above, strict=True)
        ]
        names = [str(k) for k in range(12)]
        found = group_of_likelihoods(felt, names, [0] * 12)
        mean, low, high, _ = found.contrast(np.ones(1))
        held += low < 22.0 < high
        off.append(mean - 22.0)
        without.append(value[~above.reshape(-1, 1)].mean() - 22.0)
    assert held / RUNS > 0.95 - 3 * np.sqrt(0.95 * 0.05 / RUNS)
    error = 3 * np.std(off) / np.sqrt(RUNS)
    assert abs(np.mean(off)) < error + 0.2 < 1.0 < -np.mean(without)


def test_one_who_misses_a_condition_counts_in_the_other():
    value, spread = people(6, 3.0, 0.3, 0.3, 5)
    names = [str(k) for k in range(6) for _ in (0, 1)]
    keep = np.arange(12) != 11
    some = group(
        value.ravel()[keep], spread.ravel()[keep], names[:11], np.tile([0, 1], 6)[keep].tolist()
    )
    mean, low, high, _ = some.contrast(B)
    # What the sixth has in the first tells of the second, since both hang together.
    expected = value[:5, 1].sum() + value[5, 0] + 2.0
    assert mean == pytest.approx(expected / 6, abs=0.3) and low < 24.0 < high
