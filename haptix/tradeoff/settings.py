"""What is tried for a scene: every combination of fidelity, tolerance, dtype, slice and device."""

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
"""Of the surface against its own model, in just-noticeable differences."""

QUICK_TOLERANCES = (0.05, 0.5)

TABULATED: tuple[FidelityName, ...] = (FULL, COARSE)
DTYPES: tuple[DtypeName, ...] = ("float64", "float32")


@dataclass(frozen=True)
class Setting:
    """One way to build a surface and to ask it.

    Parameters
    ----------
    model : {"mean-field", "closed-form", "boundary-element", "planned"}
        A fidelity with every term that it can have, or what `plan_scene` decides.
    tolerance : str
        Of the surface against that model.
    dtype : {"float32", "float64"}
        Of the surface that is asked.
    form : {"surface", "slice"}
        Whether force, frequency and h0 are given with every query, or the last two once.
    device : str
        Where it is asked.
    """

    model: str
    tolerance: str
    dtype: DtypeName
    form: Literal["surface", "slice"]
    device: str = "cpu"

    @property
    def asked(self) -> tuple[str, ...]:
        """How the surface is asked: dtype, form, and the device where it is not the CPU."""
        return (self.dtype, self.form, *([] if self.device == "cpu" else [self.device]))


def devices() -> tuple[str, ...]:
    """Return the processors that this machine has: "cpu", and "cuda" where there is one."""
    return ("cpu", "cuda") if torch.cuda.is_available() else ("cpu",)


def ways_to_ask() -> list[tuple[DtypeName, Literal["surface", "slice"], str]]:
    """Dtype, form and device: what can be changed of a surface that is built."""
    forms: tuple[Literal["surface", "slice"], ...] = ("surface", "slice")
    return list(product(DTYPES, forms, devices()))


def default_scene() -> Scene:
    """Return a scene in which every axis varies: the paper's finger, screens of several insulators.

    Driven directly, at the frequencies of the physics page, section 7.
    """
    return Scene(
        name="semi-wet finger, 80 to 400 Hz, several screens",
        finger=Finger.preset("semi-wet"),
        screen=Screen.preset("3m-sct3250"),
        normal_force_n=(0.1, 1.0),
        drive=DirectDrive(scheme="direct", frequency_hz=(80.0, 400.0)),
        h0_m=(0.1e-6, 0.2e-6),
    )
