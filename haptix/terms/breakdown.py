"""Breakdown: a status for fields that air or insulator do not withstand."""

import torch
from torch import Tensor

from haptix.electro.breakdown import breaks_down
from haptix.states import ContactState
from haptix.status import Status
from haptix.terms.term import FieldInGap, Properties, Term


class Breakdown(Term):
    """Reports `Status.BREAKDOWN`; friction does not change.

    The model's breakdown is a spark at the edge of a contact spot. Laboratories use such voltages
    every day, the paper's own 200 V on 1 um of SiO2 among them, so it is off unless requested.
    """

    name = "breakdown"
    summary = "report states whose field exceeds what air or the insulator bears"
    source = "physics page, section 3"
    uses = (
        "screen.insulator_thickness_m",
        "screen.insulator_permittivity",
        "screen.insulator_strength_v_per_m",
    )
    on_request = True
    reports = Status.BREAKDOWN

    def status(self, status: Tensor, field: FieldInGap, given: Properties) -> Tensor:
        screen = given.screen
        broken = breaks_down(
            field, screen.insulator_permittivity, screen.insulator_strength_v_per_m
        )
        return torch.where((status == Status.OK) & broken, int(Status.BREAKDOWN), status)

    def voltage_limit(self, state: ContactState) -> Tensor:
        return state.breakdown_voltage_v
