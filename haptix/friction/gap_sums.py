"""Sums over the gaps of solved states, which most callers of the contact model do without."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from haptix.electro import Circuit, Pull
from haptix.electro.breakdown import bearable_field, share_past
from haptix.electro.circuit import bin_inverse
from haptix.fidelity import Balance
from haptix.friction.solver import FrictionSolver
from haptix.screen import Screen
from haptix.states import GapSums
from haptix.threads import one_thread

_BLOCK = 1024  # states whose gaps are summed together: bounds the memory


@one_thread()
def sum_gaps(
    solver: FrictionSolver,
    screen: Screen,
    normal_force_n: Tensor,
    voltage_v: Tensor,
    frequency_hz: Tensor | None,
    circuit: Circuit,
    pull_of: Callable[[Tensor, Circuit], Pull],
    found: Balance,
    like: Tensor,
) -> GapSums:
    """Sum over the gaps of solved states.

    Parameters
    ----------
    solver, screen : FrictionSolver, Screen
        What solved them.
    normal_force_n, voltage_v, frequency_hz : Tensor, shape (states,)
        Normal force [N], amplitude on the contact [V], and frequency [Hz] or None.
    circuit, found : Circuit, Balance
        Of all states.
    pull_of : callable
        Attraction of states at amplitudes [V] with their part of the circuit.
    like : Tensor
        Gives shape and precision of the results.
    """
    edges, area = solver.fidelity.contact.field.gap_edges_m, solver.terms.apparent_area_m2
    borne = bearable_field(edges, screen.insulator_permittivity, screen.insulator_strength_v_per_m)
    shares, capacitances = [], []
    states = torch.arange(len(normal_force_n), device=edges.device).split(_BLOCK)
    masses = solver.gap_masses(normal_force_n, found, _BLOCK)
    for at, mass in zip(states, masses, strict=True):
        part, volts = circuit.part(at), voltage_v[at]
        own = part.thickness_m[part.column]
        pull = pull_of(volts, part)
        pull = pull.held(pull.strength)
        field = volts[:, None] / (edges + own[:, None]).abs()
        shares.append(share_past(mass * pull.kernel[pull.own_column][:, 0], field, borne))
        gaps = (mass * bin_inverse(edges, own)).sum(-1)
        capacitances.append(
            part.capacitance_f(gaps, found.area_fraction[at], area(normal_force_n[at]))
        )
    capacitance = torch.cat(capacitances) + 0j
    angular = torch.zeros_like(voltage_v) if frequency_hz is None else 2 * torch.pi * frequency_hz
    current = angular * voltage_v * capacitance.abs()
    share, farads, siemens, amperes = (
        one.to(like.dtype).reshape(like.shape)
        for one in (torch.cat(shares), capacitance.real, angular * capacitance.imag, current)
    )
    return GapSums(share, farads, siemens, None if frequency_hz is None else amperes)
