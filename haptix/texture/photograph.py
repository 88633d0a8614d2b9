"""Photographs as grey values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
from skimage.color import rgb2gray
from skimage.io import imread
from skimage.util import img_as_float64

from haptix.errors import InputError


def read_grey(image: str | Path | npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return grey pixels, shape (rows, columns), from a file or from grey or colour pixels.

    Raises
    ------
    InputError
        If the file is missing or is no image, or the pixels have no image's shape.
    """
    if isinstance(image, str | Path):
        path = Path(image)
        if not path.is_file():
            raise InputError(f"image: no file at {path}; give the path of a photograph")
        try:
            pixels = imread(path)
        except Exception:  # each of the readers behind imread has errors of its own
            raise InputError(
                f"image: {path} is not an image that can be read; expected PNG, JPEG or TIFF"
            ) from None
    else:
        try:
            pixels = np.asarray(image)
            if pixels.dtype.kind not in "buif":
                raise ValueError
        except ValueError:
            raise InputError("image: expected numbers in rows of one length") from None
    if pixels.size and pixels.ndim == 3 and pixels.shape[2] in (3, 4):
        grey = rgb2gray(img_as_float64(pixels[..., :3]))
    elif pixels.size and pixels.ndim == 3 and pixels.shape[2] == 2:
        grey = pixels[..., 0].astype(np.float64)  # grey and opacity
    elif pixels.size and pixels.ndim == 2:
        grey = pixels.astype(np.float64)
    else:
        raise InputError(
            "image: expected pixels of shape (rows, columns), or (rows, columns, channels) with 2 "
            f"to 4 channels, got {pixels.shape}"
        )
    if not np.isfinite(grey).all():
        raise InputError("image: expected finite pixels")
    return np.asarray(grey, dtype=np.float64)
