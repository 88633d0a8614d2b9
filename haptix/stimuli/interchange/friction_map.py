"""Friction over the screen as a 16-bit PNG with a sidecar for the meaning of its greys."""

from __future__ import annotations

import hashlib
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from haptix import checks
from haptix.errors import FileFormatError, InputError, from_extra
from haptix.files import (
    LARGEST_PICTURE_BYTES,
    json_text,
    read_bytes,
    read_json,
    reading,
    write_folder,
)

Array = npt.NDArray[np.float64]
MapQuantity = Literal["mu", "contrast"]

_WHITE = 65535


@dataclass(frozen=True, eq=False)
class FrictionMap:
    """Friction over a rectangle, x to the right and y downwards from its corner.

    Parameters
    ----------
    values : ndarray, shape (rows, columns)
        Friction, as `quantity` says.
    width_mm : float
        Width on the screen; pixels are square.
    quantity : {"mu", "contrast"}
        Friction coefficients, or relative changes from the friction without voltage.
    """

    values: Array
    width_mm: float
    quantity: MapQuantity = "mu"

    def __post_init__(self) -> None:
        checks.positive("width_mm", self.width_mm)
        checks.choice("quantity", self.quantity, get_args(MapQuantity))
        if self.values.ndim != 2 or not self.values.size or not np.isfinite(self.values).all():
            raise InputError(
                f"values: expected finite values in rows and columns, got {self.values.shape}"
            )

    @property
    def step(self) -> float:
        """Step of the 16 bits; rounding loses half of it at most."""
        return float(np.ptp(self.values)) / _WHITE

    def save(self, path: str | Path) -> None:
        """Write a PNG, and a JSON sidecar of the same name.

        Black and white are the lowest and highest value; nothing but rounding to 16 bits is lost.
        """
        with from_extra("stimuli"):
            from PIL import Image

        path = Path(path)
        low, high = float(self.values.min()), float(self.values.max())
        span = high - low
        level = (self.values - low) / span if span else np.zeros_like(self.values)
        file = io.BytesIO()
        Image.fromarray(np.rint(level * _WHITE).astype(np.uint16)).save(file, "png")
        picture = file.getvalue()
        table = {
            "what": "friction map",
            "quantity": self.quantity,
            "value": "black_is + grey / 65535 * (white_is - black_is)",
            "black_is": low,
            "white_is": high,
            "width_mm": self.width_mm,
            "orientation": "x to the right, y downwards",
            "lost": f"rounding to 16 bits: at most {self.step / 2:.3g} in {self.quantity}",
            "sha256": hashlib.sha256(picture).hexdigest(),
        }
        sidecar = path.with_suffix(".json").name
        write_folder(path.parent, {path.name: picture, sidecar: json_text(table)})

    @classmethod
    def load(cls, path: str | Path) -> FrictionMap:
        """Read a PNG with its sidecar.

        Raises
        ------
        FileFormatError
            If either is missing or of another form, or the sidecar is that of another picture.
        InputError
            If the picture has more pixels than a texture may have: see `check_picture`.
        """
        with from_extra("stimuli"):
            from PIL import Image

            from haptix.texture.pictures import check_picture

        path = Path(path)
        beside = path.with_suffix(".json")
        table = read_json(beside)
        with reading(beside, "the sidecar of a friction map"):
            low, high = float(table["black_is"]), float(table["white_is"])
            width, quantity = float(table["width_mm"]), table["quantity"]
        data = read_bytes(path, LARGEST_PICTURE_BYTES)
        check_picture(f"image: {path}", io.BytesIO(data))
        with reading(path, "a PNG"), Image.open(io.BytesIO(data), formats=["PNG"]) as picture:
            grey = np.asarray(picture)
        if grey.dtype != np.uint16 or grey.ndim != 2:
            raise FileFormatError(f"{path}: expected 16-bit grey, got {grey.dtype} {grey.shape}")
        if table.get("sha256") not in (None, hashlib.sha256(data).hexdigest()):
            raise FileFormatError(f"{path}: is not the picture that its sidecar was written for")
        return cls(low + grey / _WHITE * (high - low), width, quantity)
