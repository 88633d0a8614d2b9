"""Pictures from files, as they are seen: upright, over one colour, in grey."""

from __future__ import annotations

import io
import logging
import struct
import threading
from functools import cache
from math import ceil, prod, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from haptix.base.checks import Array, positive
from haptix.base.errors import InputError, from_extra
from haptix.feel.materials.decoded import LARGEST_BYTES, MOST_KEPT, MOST_PIXELS, decoded

with from_extra("photographs"):
    import tifffile
    from PIL import Image, ImageCms, ImageOps

_LOG = logging.getLogger("haptix.feel.materials")

# For each pixel, as float64: four colours and grey while it is read; then its level, and the
# pyramid (7/3 in all its levels).
_BYTES_PER_PIXEL = 8 * 5

# Pillow has many more decoders, which are not needed here; one of them runs a program.
_FORMATS = ("PNG", "JPEG", "TIFF", "GIF", "BMP", "WEBP", "PPM", "JPEG2000", "AVIF")
_EXPECTED = "expected PNG, JPEG, TIFF, GIF, WebP, AVIF, JPEG 2000, BMP or PPM"

# Offset and first bytes of files that are pictures, or are taken for pictures, and are not read.
_NOT_READ = (
    (0, b"8BPS", "a Photoshop document"),
    (0, b"%PDF", "a PDF"),
    (0, b"%!PS", "PostScript"),
    (0, b"\xff\x0a", "a JPEG XL"),
    (4, b"JXL ", "a JPEG XL"),
    (0, b"v/1\x01", "an OpenEXR"),
    (0, b"#?RADIANCE", "a Radiance HDR"),
    (0, b"\0\0\1\0", "an icon"),
    (4, b"ftyphei", "a HEIC"),
    (4, b"ftyphev", "a HEIC"),
    (4, b"ftypmif1", "a HEIF"),
    (4, b"ftypcrx", "a camera's raw picture (CR3)"),
    (4, b"ftyp", "a video"),
    (8, b"CR\x02\0", "a camera's raw picture (CR2)"),
    (0, b"FUJIFILMCCD-RAW", "a camera's raw picture (RAF)"),
    (0, b"<svg", "an SVG drawing"),
    (0, b"<?xml", "an XML document or SVG drawing"),
)
_ROWS = 64  # rows of pixels that are converted at once
_MOST_PAGES = 100  # of a TIFF: pyramids and thumbnails have a few
_READ_BY_TIFFFILE = (tifffile.PHOTOMETRIC.MINISWHITE, tifffile.PHOTOMETRIC.MINISBLACK,
                     tifffile.PHOTOMETRIC.RGB)  # fmt: skip
_CONVERTED_BY_PILLOW = ("PALETTE", "SEPARATED", "YCBCR", "CIELAB")


@cache
def _formats() -> tuple[str, ...]:
    """Return the formats that this build of Pillow can read."""
    Image.init()
    return tuple(name for name in _FORMATS if name in Image.OPEN)


def read_grey(
    image: str | Path | npt.ArrayLike, largest_bytes: int = LARGEST_BYTES, beneath: float = 0.0
) -> Array:
    """Return grey pixels, shape (rows, columns), from a file or from grey or colour pixels.

    A picture is turned upright by the camera's note, put over `beneath` (0 black, 1 white) where it
    is transparent, and converted from palettes, inks and colour profiles to sRGB. Of an animation
    the first frame is read. In a file of more than 24 megapixels, boxes of pixels are averaged.
    `InputError` is raised for a file of more than 200 megapixels (only its header is read), for one
    whose texture would take more memory than `largest_bytes`, and for one that is not a picture of
    a format that is read.
    """
    positive("largest_bytes", largest_bytes)
    if isinstance(image, str | Path):
        pixels, premultiplied = read_pixels(f"image: {image}", Path(image), largest_bytes)
    else:
        premultiplied = False
        try:
            pixels = np.asarray(image)
            if pixels.dtype.kind not in "buif":
                raise ValueError
        except ValueError:
            raise InputError("image: expected numbers in rows of one length") from None
        _check_size("image", pixels.shape, 0, largest_bytes)
    if not pixels.size or not (
        pixels.ndim == 2 or (pixels.ndim == 3 and pixels.shape[2] in (2, 3, 4))
    ):
        raise InputError(
            "image: expected pixels of shape (rows, columns), or (rows, columns, channels) with 2 "
            f"to 4 channels, got {pixels.shape}"
        )
    grey = _grey(pixels, premultiplied, beneath)
    if not np.isfinite(grey).all():
        raise InputError("image: expected finite pixels")
    return np.asarray(grey, dtype=np.float64)


def read_normals(path: Path, largest_bytes: int = LARGEST_BYTES) -> tuple[Array, Array]:
    """Return slopes to the right and downwards of a normal map, both of shape (rows, columns).

    Red is the normal's part to the right, green upwards, blue out of the surface; half of their
    range is 0.
    """
    with from_extra("photographs"):
        from skimage.util import img_as_float64  # here, since it takes a third of a second

    pixels, _ = read_pixels(f"normals: {path}", path, largest_bytes)
    if pixels.ndim != 3 or pixels.shape[2] < 3:
        raise InputError(f"normals: expected a picture in colour, got shape {pixels.shape}")
    right, up, out = (2 * img_as_float64(pixels)[..., channel] - 1 for channel in range(3))
    out = np.maximum(out, 0.05)  # steeper than 87 degrees is noise
    return -right / out, up / out


def _grey(pixels: npt.NDArray[Any], premultiplied: bool, beneath: float) -> Array:
    """Grey of pixels with 1 to 4 channels; with 2 or 4 the last is the opacity."""
    with from_extra("photographs"):
        from skimage.color import rgb2gray  # here, since these take a third of a second
        from skimage.util import img_as_float64

    if pixels.ndim == 2:
        return pixels.astype(np.float64)
    channels = pixels.shape[2]
    if channels == 2:
        grey, white = pixels[..., 0].astype(np.float64), 1.0
        if pixels.dtype.kind in "ui":
            white = float(np.iinfo(pixels.dtype).max)
    else:
        grey, white = np.empty(pixels.shape[:2]), 1.0
        for first in range(0, len(pixels), _ROWS):  # float64 of all colours would be 600 MB
            rows = slice(first, first + _ROWS)
            grey[rows] = rgb2gray(img_as_float64(pixels[rows, :, :3]))
    if channels in (2, 4):
        opacity = img_as_float64(pixels[..., -1])
        if not ((opacity >= 0) & (opacity <= 1)).all():
            raise InputError("image: expected opacities from 0 to 1 in the last channel")
        if opacity.min() < 1:
            grey = (grey if premultiplied else opacity * grey) + (1 - opacity) * white * beneath
    return np.asarray(grey)


def read_pixels(
    name: str, path: Path, largest_bytes: int = LARGEST_BYTES
) -> tuple[npt.NDArray[Any], bool]:
    """Return pixels of 1 to 4 channels, and whether colours have been multiplied by opacity.

    Errors call the file `name`. `haptix.feel.materials.decoded` says which process decodes it.
    """
    if not path.is_file():
        what = name.partition(":")[0]
        raise InputError(f"{what}: no file at {path}; give the path of a photograph")
    return decoded(path, lambda: _averaged(name, *_decode(name, path, largest_bytes)))


def _decode(name: str, path: Path, largest_bytes: int) -> tuple[npt.NDArray[Any], bool]:
    check_picture(name, path, largest_bytes)
    try:
        if path.suffix.lower() in (".tif", ".tiff"):
            with tifffile.TiffFile(path) as tiff:
                if tiff.pages.first.photometric in _READ_BY_TIFFFILE:
                    try:
                        return _of_tiff(tiff)
                    except ValueError:  # a compression that only Pillow can read
                        pass
        with _opened(path) as picture:
            return _of_pillow(picture), False
    except Exception:  # each decoder raises its own classes of errors
        raise _no_image(name, path) from None


def _opened(file: Path | io.BytesIO) -> Image.Image:
    """Open a picture without Pillow's limit of size; this module has checked the size."""
    with _LOCK:
        limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            return Image.open(file, formats=_formats())
        finally:
            Image.MAX_IMAGE_PIXELS = limit


_LOCK = threading.Lock()  # all threads share Pillow's limit


def _boxes(shape: tuple[int, ...]) -> tuple[int, int]:
    """Rows and columns of the box of pixels that is averaged to one pixel."""
    rows, columns = shape[:2]
    step = ceil(sqrt(rows * columns / MOST_KEPT) - 1e-3)  # a decoder that halves sizes rounds up
    return max(1, min(step, rows)), max(1, min(step, columns))


def _averaged(
    name: str, pixels: npt.NDArray[Any], premultiplied: bool
) -> tuple[npt.NDArray[Any], bool]:
    """Average boxes of pixels; colours are weighted by their opacity."""
    high, wide = _boxes(pixels.shape)
    if high == wide == 1:
        return pixels, premultiplied
    rows, columns, *channels = pixels.shape
    kept = np.empty((rows // high, columns // wide, *channels), pixels.dtype)
    has_opacity = channels in ([2], [4])
    white = np.iinfo(pixels.dtype).max if pixels.dtype.kind in "ui" else 1.0
    for row, mean in enumerate(kept):
        band = pixels[row * high : (row + 1) * high, : mean.shape[0] * wide].astype(np.float64)
        if has_opacity and not premultiplied:
            band[..., :-1] *= band[..., -1:] / white
        boxes = band.reshape(high, mean.shape[0], wide, *channels).mean((0, 2))
        mean[...] = np.rint(boxes) if pixels.dtype.kind in "ui" else boxes
    size = " x ".join(map(str, kept.shape[1::-1]))
    _LOG.info("%s: %d x %d pixels are averaged to %s", name, columns, rows, size)
    return kept, premultiplied or has_opacity


def _of_pillow(picture: Image.Image) -> npt.NDArray[Any]:
    """Pixels of the first frame, upright and in grey or sRGB."""
    step = max(_boxes((picture.height, picture.width)))
    if step in (2, 4, 8):  # a JPEG's decoder can do this, with less time and memory
        picture.draft(None, (picture.width // step, picture.height // step))
    picture.load()
    upright: Image.Image = ImageOps.exif_transpose(picture)
    if upright.mode in ("CMYK", "LAB", "RGB", "RGBA"):
        upright = _in_srgb(upright)
    if upright.mode[0] in "IF":  # more than 8 bits
        return np.asarray(upright)
    if upright.mode in ("1", "L", "LA", "La") and upright.has_transparency_data:
        upright = upright.convert("LA")
    elif upright.has_transparency_data:
        upright = upright.convert("RGBA")
    elif upright.mode in ("P", "CMYK", "YCbCr", "HSV", "RGBX"):
        upright = upright.convert("RGB")
    return np.asarray(upright)


def _in_srgb(picture: Image.Image) -> Image.Image:
    """Apply a picture's colour profile, as viewers do; without a profile inks count as ideal."""
    mode = "RGBA" if picture.mode == "RGBA" else "RGB"
    data = picture.info.get("icc_profile")
    converted: Image.Image | None = None
    if picture.mode == "LAB":
        of, to = ImageCms.createProfile("LAB"), ImageCms.createProfile("sRGB")
        converted = ImageCms.profileToProfile(picture, of, to, outputMode=mode)
    elif data:
        try:
            profile = ImageCms.ImageCmsProfile(io.BytesIO(data))
            if "srgb" not in ImageCms.getProfileDescription(profile).lower():
                to = ImageCms.createProfile("sRGB")
                converted = ImageCms.profileToProfile(picture, profile, to, outputMode=mode)
        except (ImageCms.PyCMSError, OSError):  # ignore a damaged profile
            pass
    return picture if converted is None else converted


def _of_tiff(tiff: tifffile.TiffFile) -> tuple[npt.NDArray[Any], bool]:
    """Upright pixels of grey or RGB and opacity, with all their bits, without other channels."""
    page = tiff.pages.first
    pixels = np.asarray(tiff.series[0].asarray())
    if tiff.series[0].axes.startswith("S"):  # channel by channel
        pixels = np.moveaxis(pixels, 0, -1)
    if page.photometric == tifffile.PHOTOMETRIC.MINISWHITE:
        pixels = (2**page.bitspersample - 1) - pixels.astype(np.int64)
    colours = 3 if page.photometric == tifffile.PHOTOMETRIC.RGB else 1
    extra = [int(kind) for kind in page.extrasamples]
    alphas = [i for i, kind in enumerate(extra) if kind in (1, 2)]
    if pixels.ndim == 3:
        channels = [*range(colours), *(colours + i for i in alphas[:1])]
        pixels = pixels[..., channels] if len(channels) > 1 else pixels[..., 0]
    tag = page.tags.get("Orientation")
    pixels = _turned(pixels, 1 if tag is None else int(tag.value))
    return pixels, bool(alphas) and extra[alphas[0]] == 1


def _turned(pixels: npt.NDArray[Any], orientation: int) -> npt.NDArray[Any]:
    """Upright pixels; the orientation states where row 0 and column 0 are (TIFF 6.0, page 36)."""
    if orientation in (5, 6, 7, 8):
        pixels = pixels.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    return pixels


def check_picture(
    name: str,
    file: Path | io.BytesIO,
    largest_bytes: int = LARGEST_BYTES,
    most_pixels: int = MOST_PIXELS,
) -> None:
    """Refuse, by its header alone, a file that is not a single picture or has too many pixels.

    Raises `InputError` if it is not such a picture.

    Parameters
    ----------
    name : str
        What error messages call it.
    file : Path or BytesIO
        Of any format.
    largest_bytes : int
        Limit of the memory for reading it and making a texture of it.
    most_pixels : int
        Of the file; `MOST_KEPT` where they are not averaged.
    """
    try:
        shape, kind = _header(name, file)
    except InputError:
        raise
    except Exception:  # each decoder raises its own classes of errors
        raise _no_image(name, file) from None
    _check_size(name, shape, kind, largest_bytes, most_pixels)


def _no_image(name: str, file: Path | io.BytesIO) -> InputError:
    """Return the error for a file that is not read; it names the file's format if it is known."""
    head = b""
    try:
        with io.BytesIO(file.getvalue()) if isinstance(file, io.BytesIO) else file.open("rb") as f:
            head = f.read(64).lstrip(b"\xef\xbb\xbf \r\n\t")
    except OSError:
        pass
    for at, first_bytes, kind in _NOT_READ:
        if head[at:].startswith(first_bytes):
            return InputError(f"{name} is {kind}, which is not read; save it as PNG")
    return InputError(f"{name} is not an image that can be read; {_EXPECTED}")


def _header(name: str, file: Path | io.BytesIO) -> tuple[tuple[int, ...], int]:
    """Shape of the pixels, and the bytes of each channel of a pixel."""
    # TIFF is read by tifffile, which may take more of a file than Pillow's first frame.
    if isinstance(file, Path) and file.suffix.lower() in (".tif", ".tiff"):
        _check_pages(name, file)
        with tifffile.TiffFile(file) as tiff:
            return _tiff_header(name, tiff)
    with _opened(file) as picture:
        # A palette becomes three channels, and one transparent colour becomes a channel of opacity.
        channels = max(len(picture.getbands()), 4 if picture.has_transparency_data else 1)
        return (picture.height, picture.width, 3 if picture.mode == "P" else channels), 2


def _check_pages(name: str, file: Path) -> None:
    """Refuse a TIFF with too many pages, or with pages in a loop, which tifffile would not end."""
    with file.open("rb") as opened:
        head = opened.read(16)
        order = "<" if head[:2] == b"II" else ">"
        is_big = head[2:4] in (b"+\0", b"\0+")
        count, offset, entry = ("Q", "Q", 20) if is_big else ("H", "I", 12)
        at = struct.unpack_from(order + offset, head, 8 if is_big else 4)[0]
        size, most = file.stat().st_size, struct.calcsize(order + offset)
        for _ in range(_MOST_PAGES):
            if not 0 < at < size:
                return
            opened.seek(at)
            tags = struct.unpack(order + count, opened.read(struct.calcsize(count)))[0]
            opened.seek(at + struct.calcsize(order + count) + entry * tags)
            after = opened.read(most)
            at = struct.unpack(order + offset, after)[0] if len(after) == most else 0
    raise InputError(f"{name} has more than {_MOST_PAGES} pages; save one as PNG")


def _tiff_header(name: str, tiff: tifffile.TiffFile) -> tuple[tuple[int, ...], int]:
    page, series = tiff.pages.first, tiff.series[0]
    if "DNGVersion" in page.tags:
        raise InputError(f"{name} is a camera's raw picture (DNG), which is not read; develop it")
    if not isinstance(page.photometric, tifffile.PHOTOMETRIC) or (
        page.photometric not in _READ_BY_TIFFFILE
        and page.photometric.name not in _CONVERTED_BY_PILLOW
    ):
        kind = getattr(page.photometric, "name", page.photometric)
        raise InputError(f"{name} is a TIFF of colours {kind}, which is not read; save it as RGB")
    if series.axes.strip("S") != "YX":
        raise InputError(f"{name} has several pages or frames; expected one picture, save one")
    rows, columns = page.imagelength, page.imagewidth
    return (rows, columns, page.samplesperpixel), int(series.dtype.itemsize)


def _check_size(
    name: str, shape: tuple[int, ...], kind: int, largest_bytes: int, of_file: int | None = None
) -> None:
    size = f"{name} has {' x '.join(map(str, shape[1::-1]))} pixels"
    hint = "scale it down, since a fingertip feels nothing below some 0.05 mm"
    if of_file is not None:
        if prod(shape[:2]) > of_file:
            raise InputError(f"{size}; expected at most {of_file / 1e6:g} megapixels: {hint}")
        high, wide = _boxes(shape)
        shape = (shape[0] // high, shape[1] // wide, *shape[2:])
    pixels = prod(shape[:2])
    # The conversion of colour takes a float64 for each channel.
    channels = prod(shape[2:])
    needed = pixels * (_BYTES_PER_PIXEL + channels * kind + (8 * channels if channels > 2 else 0))
    if needed > largest_bytes:
        raise InputError(
            f"{size}, a texture of some {needed / 1e9:.3g} GB; expected at most "
            f"{largest_bytes / 1e9:.3g} GB: {hint}, or raise largest_bytes"
        )
