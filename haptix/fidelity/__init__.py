"""How a contact is solved: one face, several prices."""

from haptix.fidelity.balance import Balance, Fidelity, Load
from haptix.fidelity.closed_form import ClosedForm
from haptix.fidelity.mean_field import MeanFieldBalance

__all__ = ["Balance", "ClosedForm", "Fidelity", "Load", "MeanFieldBalance"]
