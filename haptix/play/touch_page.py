"""A layout as a folder that any web server can serve: a page, its engine, a program of a touch."""

from __future__ import annotations

import html
import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from haptix.feel.layout.layout_material import shown_place_mm
from haptix.feel.materials.picture import picture

if TYPE_CHECKING:
    from haptix.feel.materials import Material

_PAGE = Path(__file__).with_name("page")
_COPY = _PAGE / "engine"  # of the engine for pages, in a wheel
_CHECKOUT = Path(__file__).parents[2] / "clients"
_COLUMNS = 720


def engine_files() -> dict[str, bytes]:
    """Return the modules of `haptix-engine`, by name, and what draws a figure that is felt."""
    engine = _COPY if _COPY.is_dir() else _CHECKOUT / "engine" / "src"
    glass = (_COPY if _COPY.is_dir() else _CHECKOUT / "typescript" / "src") / "glass.js"
    files = {*engine.iterdir(), glass, _PAGE / "felt.js", _PAGE / "felt.css"}
    return {path.name: path.read_bytes() for path in sorted(files)}


def page_files(program: bytes, felt: Material, title: str) -> dict[str, bytes]:
    """Return the files of a page that plays a program of a touch, by name.

    The page needs no service and no build step, but a web server: browsers load no module from a
    file.

    Parameters
    ----------
    program : bytes
        Of `compile_touch`.
    felt : Material
        The compiled material; the page shows a picture of it, dark where the friction is low.
    title : str
        Heading of the page.

    Examples
    --------
    >>> from haptix.feel.materials import Grating
    >>> sorted(page_files(b"", Grating(period_mm=2.0), "Ribs"))[-4:]
    ['touch.hxp', 'virtual-driver.js', 'virtual-link.js', 'worker.js']
    """
    left, right, top, bottom = shown_place_mm(felt)
    wanted = picture(felt, right - left, bottom - top, _COLUMNS, corner_mm=(left, top))
    text = (_PAGE / "index.html").read_text("utf-8")
    text = text.replace("TITLE", html.escape(title))
    text = text.replace("PLACE", f"{left:.6g} {top:.6g} {right - left:.6g}")
    return {
        **engine_files(),
        "index.html": text.encode(),
        "picture.png": _grey(wanted),
        "touch.hxp": program,
    }


def _grey(values: np.ndarray) -> bytes:
    from PIL import Image

    low, high = np.nanmin(values), np.nanmax(values)
    share = (values - low) / (high - low) if high > low else np.full(values.shape, 0.5)
    levels = np.rint(40 + 200 * np.nan_to_num(share)).astype(np.uint8)
    packed = io.BytesIO()
    Image.fromarray(levels).save(packed, "png")
    return packed.getvalue()
