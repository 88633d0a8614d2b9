"""The front: what nothing beats."""

from hypothesis import given
from hypothesis import strategies as st

from haptix.plan.tradeoff import pareto_front

costs = st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), max_size=12)


def at_least_as_good(one, other):
    return one[0] <= other[0] and one[1] <= other[1]


def test_a_front_by_hand():
    #        beaten by (2, 2)                beaten by (1, 9): as slow, more error
    assert pareto_front([(1, 9), (2, 2), (3, 3), (9, 1), (2, 2), (1, 10)]) == [
        True,
        True,
        False,
        True,
        True,  # equals stand together
        False,
    ]


@given(costs)
def test_nothing_on_the_front_is_beaten_and_everything_else_is(points):
    on = pareto_front(points)
    front = [point for point, is_on in zip(points, on, strict=True) if is_on]
    for point, is_on in zip(points, on, strict=True):
        beaten = any(at_least_as_good(other, point) and other != point for other in points)
        assert is_on is not beaten
        assert any(at_least_as_good(other, point) for other in front)


@given(costs, st.randoms(use_true_random=False))
def test_the_order_does_not_matter(points, random):
    shuffled = list(points)
    random.shuffle(shuffled)
    front = {p for p, is_on in zip(points, pareto_front(points), strict=True) if is_on}
    again = {p for p, is_on in zip(shuffled, pareto_front(shuffled), strict=True) if is_on}
    assert front == again
