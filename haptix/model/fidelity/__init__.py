"""Fidelities: ways to solve a contact behind one interface, from the fast to the exact."""

from collections.abc import Mapping
from typing import Literal

from haptix.model.fidelity.balance import Ability, Balance, Contact, Fidelity, Load
from haptix.model.fidelity.boundary_element import BoundaryElementBalance, Scatter, UnsettledWarning
from haptix.model.fidelity.box import BoundaryElementBox, BoxedFinger
from haptix.model.fidelity.mean_field import ClosedForm, MeanFieldBalance

FidelityName = Literal["closed-form", "mean-field", "boundary-element"]

FIDELITIES: Mapping[FidelityName, type[Fidelity]] = {
    "closed-form": ClosedForm,
    "mean-field": MeanFieldBalance,
    "boundary-element": BoundaryElementBalance,
}
"""Fidelities by name, the fastest first."""

__all__ = [
    "FIDELITIES",
    "Ability",
    "Balance",
    "BoundaryElementBalance",
    "BoundaryElementBox",
    "BoxedFinger",
    "ClosedForm",
    "Contact",
    "Fidelity",
    "FidelityName",
    "Load",
    "MeanFieldBalance",
    "Scatter",
    "UnsettledWarning",
]
