"""One task of the kinds "population" and "boundary-elements": states of a finger on a screen."""

from __future__ import annotations

import json
import warnings
from itertools import product
from typing import Any

import torch

from haptix.fidelity import BoundaryElementBox
from haptix.finger import Finger
from haptix.friction import ContactModel
from haptix.screen import Screen
from haptix.status import Status

_FOUND = ("mu", "area_fraction", "pressure_pa", "mean_gap_m")


def states_of(text: str) -> str:
    """Solve one finger on one screen.

    Parameters
    ----------
    text : str
        JSON: ``finger``, ``screen``, lists ``normal_force_n``, ``voltage_v`` and ``frequency_hz``,
        and for boundary elements ``box``.

    Returns
    -------
    str
        JSON: a list of values for each column, over all combinations; the frequency is fastest.
    """
    given = json.loads(text)
    names = ("normal_force_n", "voltage_v", "frequency_hz")
    grid = [*product(*(given[name] for name in names))]
    columns = torch.tensor(grid, dtype=torch.float64).T
    at = dict(zip(names, columns, strict=True))
    how: dict[str, Any] = {}
    if "box" in given:
        box = BoundaryElementBox(**given["box"], most_states=len(grid))
        how = {"fidelity": "boundary-element", "boundary_elements": box}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the box: it is what the plan asks for
        model = ContactModel(Finger(**given["finger"]), Screen(**given["screen"]), **how)
        state = model.solve(**at)
    found = {name: values.tolist() for name, values in at.items()}
    found |= {name: getattr(state, name).double().tolist() for name in _FOUND}
    found["status"] = [Status(int(one)).name for one in state.status]
    return json.dumps(found)
