"""Photographs and height maps as levels of friction."""

from __future__ import annotations

import io
import warnings
from math import cos, prod, radians, sin
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt
import tifffile
from PIL import Image, UnidentifiedImageError

from haptix.checks import Array, choice, positive
from haptix.errors import InputError

LARGEST_BYTES = 1_500_000_000
"""Default limit of the memory that making a texture takes: some 24 megapixels."""

# For each pixel: grey and level, the levels of the pyramid (7/3) and one more that is being made,
# each as a float64.
_BYTES_PER_PIXEL = 8 * 6


def read_grey(image: str | Path | npt.ArrayLike, largest_bytes: int = LARGEST_BYTES) -> Array:
    """Return grey pixels, shape (rows, columns), from a file or from grey or colour pixels.

    `largest_bytes` limits the memory for reading it and making a texture of it. A larger image
    raises `InputError` before more than its header is read. So does a file that is not an image.
    """
    from skimage.color import rgb2gray  # these take a third of a second
    from skimage.io import imread
    from skimage.util import img_as_float64

    positive("largest_bytes", largest_bytes)
    if isinstance(image, str | Path):
        path = Path(image)
        if not path.is_file():
            raise InputError(f"image: no file at {path}; give the path of a photograph")
        check_picture(f"image: {path}", path, largest_bytes)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # size is checked
                pixels = imread(path)
        except Exception:  # each of the readers behind imread has errors of its own
            raise _no_image(f"image: {path}") from None
    else:
        try:
            pixels = np.asarray(image)
            if pixels.dtype.kind not in "buif":
                raise ValueError
        except ValueError:
            raise InputError("image: expected numbers in rows of one length") from None
        _check_size("image", pixels.shape, 0, largest_bytes)
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


def read_normals(path: Path, largest_bytes: int = LARGEST_BYTES) -> tuple[Array, Array]:
    """Return slopes to the right and downwards of a normal map, both of shape (rows, columns).

    Red is the normal's part to the right, green upwards, blue out of the surface; half of their
    range is 0.
    """
    from skimage.io import imread
    from skimage.util import img_as_float64

    check_picture(f"normals: {path}", path, largest_bytes)
    pixels = img_as_float64(imread(path))
    if pixels.ndim != 3 or pixels.shape[2] < 3:
        raise InputError(f"normals: expected a picture in colour, got shape {pixels.shape}")
    right, up, out = (2 * pixels[..., channel] - 1 for channel in range(3))
    out = np.maximum(out, 0.05)  # steeper than 87 degrees is noise
    return -right / out, up / out


def check_picture(name: str, file: Path | io.BytesIO, largest_bytes: int = LARGEST_BYTES) -> None:
    """Refuse, by its header alone, a file that is no single picture or has too many pixels.

    Parameters
    ----------
    name : str
        What error messages call it.
    file : Path or BytesIO
        Of any format.
    largest_bytes : int
        Limit of the memory for reading it and making a texture of it.

    Raises
    ------
    InputError
        If it is not such a picture.
    """
    try:
        shape, kind, is_one = _header(file)
    except Image.DecompressionBombError as error:
        raise InputError(f"{name} is too large ({error}); scale it down") from None
    except Exception:  # each format has errors of its own
        raise _no_image(name) from None
    if not is_one:
        raise InputError(f"{name} has several frames; expected one picture, save one of them")
    _check_size(name, shape, kind, largest_bytes)


def _no_image(name: str) -> InputError:
    return InputError(f"{name} is not an image that can be read; expected PNG, JPEG or TIFF")


def _header(file: Path | io.BytesIO) -> tuple[tuple[int, ...], int, bool]:
    """Shape of the pixels, bytes of each channel of one, and whether it is one picture."""
    try:
        # TIFF is read by tifffile, which may take more of a file than Pillow's first frame.
        if isinstance(file, Path) and file.suffix.lower() in (".tif", ".tiff"):
            raise UnidentifiedImageError
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(file) as picture:
                # A camera's MPO has pictures of other sizes behind the one that is read.
                is_one = picture.format == "MPO" or not getattr(picture, "is_animated", False)
                shape = (picture.height, picture.width, len(picture.getbands()))
                return shape, 2, is_one
    except UnidentifiedImageError:  # TIFF has kinds that Pillow does not know
        with tifffile.TiffFile(file) as tiff:
            page = tiff.series[0]
            return tuple(page.shape), int(page.dtype.itemsize), True


def _check_size(name: str, shape: tuple[int, ...], kind: int, largest_bytes: int) -> None:
    pixels = prod(shape[:2])
    # Colour is converted in one float64 for each channel.
    channels = prod(shape[2:])
    needed = pixels * (_BYTES_PER_PIXEL + channels * kind + (8 * channels if channels > 2 else 0))
    if needed > largest_bytes:
        raise InputError(
            f"{name} has {' x '.join(map(str, shape[1::-1]))} pixels, a texture of some "
            f"{needed / 1e9:.3g} GB; expected at most {largest_bytes / 1e9:.3g} GB: scale it down, "
            "since a fingertip feels nothing below some 0.05 mm, or raise largest_bytes"
        )


HeightRule = Literal["height", "slope-magnitude", "slope-along"]
"""``"height"``: the higher, the more friction. ``"slope-magnitude"``: the steeper in whatever
direction, the more. ``"slope-along"``: what a finger that strokes along `direction_deg` feels as
lateral force, more uphill and less downhill, with level 0.5 on the flat (Robles-De-La-Torre and
Hayward, Nature 412, 445 (2001)); a stroke against the direction feels it inside out."""

_CLIPPED = 99.0  # percentile of steepness that becomes the end of the range


def levels_by_rule(heights: Array, rule: HeightRule, direction_deg: float) -> Array:
    """Levels from 0 to 1 of heights, both of shape (rows, columns).

    The scale of the heights does not matter: their 1st and 99th percentile, or the 99th of their
    slope's size, become the ends of the range. A map that is flat by the rule raises `InputError`.
    """
    choice("rule", rule, get_args(HeightRule))
    if rule == "height":
        return stretched(heights)
    if min(heights.shape) < 2:
        raise InputError(f"heights: expected 2 x 2 values or more for a slope, got {heights.shape}")
    down, right = np.gradient(heights)
    if rule == "slope-magnitude":
        steepness = np.hypot(right, down)
        offset, scale = 0.0, 1.0
    else:
        angle = radians(direction_deg)
        steepness = cos(angle) * right + sin(angle) * down
        offset, scale = 0.5, 0.5
    top = np.percentile(np.abs(steepness), _CLIPPED)
    if not top > 0:
        raise InputError("heights: expected slopes, got a plane of one height")
    return np.asarray(np.clip(offset + scale * steepness / top, 0.0, 1.0))


def stretched(values: Array) -> Array:
    """Levels from 0 to 1 between the 1st and 99th percentile: single pixels do not decide."""
    low, high = np.percentile(values, (1.0, 99.0))
    if high <= low:
        raise InputError("image: expected some contrast, got pixels of one grey")
    return np.asarray(np.clip((values - low) / (high - low), 0.0, 1.0))
