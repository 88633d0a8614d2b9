"""Contacts of hardly any load: each has a status, alone and in a batch."""

import pytest
import torch

from haptix import ContactModel, Finger, Screen, Status
from haptix.model import THEORIES

FAINT = (1.0e-4, 0.09, 0.025, 1.5e-10)  # normal force [N], voltage [V], frequency [Hz], h0 [m]
USUAL = (0.5, 100.0, 4000.0, 1e-6)


@pytest.mark.parametrize("theory", THEORIES)
def test_a_faint_contact_is_solved_and_changes_no_other_of_its_batch(theory):
    model = ContactModel(Finger.preset("dry"), Screen.preset("3m-sct3250"), theory=theory)
    alone = model.solve(*USUAL)
    batch = model.solve(*torch.tensor([FAINT, USUAL], dtype=torch.float64).T)
    assert batch.status[0] == Status.OK
    # Spots attract with at most eps0 V0^2 / 4 h0^2 = 0.8 MPa, and bear 50 MPa: 1.6 % of friction.
    still = model.solve(FAINT[0], 0.0, *FAINT[2:])
    assert batch.mu[0] == pytest.approx(still.mu.item(), rel=0.017)
    assert batch.mu[1] == pytest.approx(alone.mu.item(), rel=1e-9)
