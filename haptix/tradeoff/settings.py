"""Settings of a tradeoff: every combination of fidelity, tolerance, dtype, slice and device."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Literal

import torch

from haptix.fidelity import FidelityName
from haptix.finger import Finger
from haptix.planning.choices import COARSE, FULL
from haptix.scene import DirectDrive, DtypeName, Scene
from haptix.screen import Screen

TOLERANCES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
"""Tolerances of the surface against its own model [JND]."""

QUICK_TOLERANCES = (0.05, 0.5)

TABULATED: tuple[FidelityName, ...] = (FULL, COARSE)
DTYPES: tuple[DtypeName, ...] = ("float64", "float32")


@dataclass(frozen=True)
class Setting:
    """One way to build and query a surface.

    Parameters
    ----------
    model : {"mean-field", "closed-form", "boundary-element", "planned"}
        A fidelity with every possible term, or the choice of `plan_scene`.
    tolerance : str
        Tolerance of the surface against that model.
    dtype : {"float32", "float64"}
        Precision of the surface.
    form : {"surface", "slice"}
        Whether every query gives frequency and h0, or the surface is sliced at them once.
    device : str
        Device of the queries.
    """

    model: str
    tolerance: str
    dtype: DtypeName
    form: Literal["surface", "slice"]
    device: str = "cpu"

    @property
    def asked(self) -> tuple[str, ...]:
        """How the surface is queried: dtype, form, and the device if it is not the CPU."""
        return (self.dtype, self.form, *([] if self.device == "cpu" else [self.device]))


def ways_to_ask() -> list[tuple[DtypeName, Literal["surface", "slice"], str]]:
    """Dtypes, forms and devices in which a surface can be queried."""
    forms: tuple[Literal["surface", "slice"], ...] = ("surface", "slice")
    devices = ("cpu", "cuda") if torch.cuda.is_available() else ("cpu",)
    return list(product(DTYPES, forms, devices))


def default_scene() -> Scene:
    """Return a scene in which every axis varies: the paper's finger on several insulators.

    The drive is direct, at the frequencies of the physics page, section 7.
    """
    return Scene(
        name="semi-wet finger, 80 to 400 Hz, several screens",
        finger=Finger.preset("semi-wet"),
        screen=Screen.preset("3m-sct3250"),
        normal_force_n=(0.1, 1.0),
        drive=DirectDrive(scheme="direct", frequency_hz=(80.0, 400.0)),
        h0_m=(0.1e-6, 0.2e-6),
    )
