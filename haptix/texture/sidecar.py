"""The file beside a photograph that says how it is to be felt."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from haptix.documents import Document
from haptix.errors import FileFormatError, InputError
from haptix.texture.field import Target, check_range
from haptix.units import with_numbers


class Sidecar(Document):
    """How a photograph is to be felt; JSON beside it, ``brick.json`` for ``brick.png``.

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
    target: Target = "share"
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
        """Read a JSON file; lengths may be strings with units, such as "6 cm".

        Raises
        ------
        FileFormatError
            If the file is missing, is not JSON, or is of a later schema.
        InputError
            If a field is unknown, missing or outside its range.
        """
        path = Path(path)
        try:
            fields: Any = json.loads(path.read_text(encoding="utf-8"), parse_constant=_no_constant)
        except OSError as error:
            raise FileFormatError(
                f"cannot read {path}: {error.strerror}; it says how the image beside it is felt: "
                '{"width_mm": 60, "polarity": "bright-high"}'
            ) from None
        except (ValueError, RecursionError) as error:
            raise FileFormatError(f"{path}: expected a JSON file, got: {error}") from None
        if not isinstance(fields, dict):
            raise FileFormatError(f"{path}: expected a JSON object, got {fields!r:.40}")
        version = fields.get("schema_version", 1)
        if version != 1:
            raise FileFormatError(
                f"{path}: expected schema_version 1, got {version!r}; update haptix to read it"
            )
        try:
            return cls(**with_numbers(cls.__name__, fields))
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    def save(self, path: str | Path) -> None:
        """Write JSON that `load` reads back to an equal one, whole or not at all."""
        path = Path(path)
        whole = path.with_name(path.name + ".part")
        try:
            text = json.dumps(self.model_dump(mode="json"), indent=2)
            whole.write_text(text + "\n", encoding="utf-8")
            whole.replace(path)
        except OSError as error:
            raise FileFormatError(f"cannot write {path}: {error.strerror}") from None
        finally:
            whole.unlink(missing_ok=True)


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is no number of JSON")
