"""How a contact is solved: one face, several prices."""

from haptix.fidelity.balance import Balance, Fidelity, Load
from haptix.fidelity.boundary_element import BoundaryElementBalance, Scatter, UnsettledWarning
from haptix.fidelity.box import BoundaryElementBox, BoxedFinger
from haptix.fidelity.closed_form import ClosedForm
from haptix.fidelity.mean_field import MeanFieldBalance

__all__ = [
    "Balance",
    "BoundaryElementBalance",
    "BoundaryElementBox",
    "BoxedFinger",
    "ClosedForm",
    "Fidelity",
    "Load",
    "MeanFieldBalance",
    "Scatter",
    "UnsettledWarning",
]
