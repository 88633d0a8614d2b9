"""Surfaces and states in several processes: torch moves the memory of what it sends to another."""

import copy
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.reduction import ForkingPickler

import numpy as np
import pytest
import torch

from haptix import ContactModel, FrictionSurface
from haptix.model.surface.interpolant import Slice

VOLTS = [0.0, 100.0, 200.0]


@pytest.fixture
def surface(model: ContactModel) -> FrictionSurface:
    return FrictionSurface.build(
        model, {"normal_force_n": (0.1, 1.0), "frequency_hz": (60.0, 1e4)}, "0.05 JND"
    )


def answers(surface: FrictionSurface) -> list[float]:
    volts = surface.voltage([0.3, 0.32], 0.5, 125.0)
    column = surface.column(0.5, 125.0).mu(np.array(VOLTS))
    return [*surface.mu(0.5, VOLTS, 125.0).tolist(), *volts.voltage_v.tolist(), *column.tolist()]


def test_a_surface_answers_as_before_after_it_was_sent(surface: FrictionSurface) -> None:
    before, slice_ = answers(surface), Slice.of(surface.at(frequency_hz=125.0).table)
    columns = slice_.columns.copy()
    ForkingPickler.dumps(surface)
    assert surface.table.columns.is_shared()  # torch has moved them
    kept = [np.full(count, 7e33) for count in range(1, 3000)]  # over what it has freed
    assert answers(surface) == before and len(kept) == 2999
    assert np.array_equal(slice_.columns, columns)


@pytest.mark.slow  # starts two processes with torch
@pytest.mark.parametrize("start", ["spawn", "forkserver"])
def test_workers_answer_as_the_sender(surface: FrictionSurface, start: str) -> None:
    before = answers(surface)
    with ProcessPoolExecutor(2, multiprocessing.get_context(start)) as pool:
        assert list(pool.map(answers, [surface] * 3)) == [before] * 3
    assert answers(surface) == before


@pytest.mark.parametrize("frequency_hz", [None, 125.0])
def test_states_are_sent_with_all_their_values(
    model: ContactModel, frequency_hz: float | None
) -> None:
    state = model.solve([0.2, 0.5], 150.0, frequency_hz)
    for sent in (pickle.loads(pickle.dumps(state)), copy.deepcopy(state)):
        assert repr(sent) == repr(state) and sent.warnings() == state.warnings()
        for name in (
            "mu", "status", "mean_gap_m", "pull_past_breakdown", "capacitance_f", "spot_pressure_pa"
        ):  # fmt: skip
            assert torch.equal(getattr(sent, name), getattr(state, name)), name
        assert sent.mu is not state.mu and sent.status is not state.status
        assert torch.equal(sent.accuracy.ratio, state.accuracy.ratio)
        assert (sent.current_a is None) == (frequency_hz is None)
