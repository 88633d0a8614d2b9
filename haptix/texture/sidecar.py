"""The file beside a photograph with its size and friction."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from haptix.documents import Document
from haptix.errors import FileFormatError
from haptix.texture.field import check_range


class Sidecar(Document):
    """Size and friction of a photograph; JSON beside it, ``brick.json`` for ``brick.png``.

    Parameters
    ----------
    width_mm : float
        Width on the screen.
    polarity : {"bright-high", "dark-high"}
        Which end of the grey scale has the higher friction.
    target : {"mu", "contrast", "share"}
        What `low` and `high` are, see `haptix.texture.as_mu`.
    low, high : float
        Values of the two ends of the grey scale; 0 and 1 where the target is a share.

    Raises
    ------
    InputError
        If a field is unknown, missing or outside its range.
    """

    width_mm: Annotated[float, Field(gt=0, strict=True)]
    polarity: Literal["bright-high", "dark-high"]
    target: Literal["mu", "contrast", "share"] = "share"
    low: Annotated[float, Field(strict=True)] = 0.0
    high: Annotated[float, Field(strict=True)] = 1.0

    @model_validator(mode="after")
    def _is_a_range(self) -> Self:
        if self.target != "share" and not {"low", "high"} <= self.model_fields_set:
            raise ValueError(f"expected low and high for a target of {self.target}")
        check_range("low, high", self.target, self.low, self.high)
        return self

    @classmethod
    def path_for(cls, image: str | Path) -> Path:
        """Path of the sidecar of an image."""
        return Path(image).with_suffix(".json")

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a JSON file; see `haptix.documents.Document.load`."""
        if not Path(path).exists():
            raise FileFormatError(
                f"cannot read {path}: no such file; it says how the image beside it is felt: "
                '{"width_mm": 60, "polarity": "bright-high"}'
            )
        return super().load(path)
