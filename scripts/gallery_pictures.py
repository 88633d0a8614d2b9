"""Pictures of the gallery: the pages of docs/gallery call this as the site is built."""

from __future__ import annotations

import base64
import io
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def picture(figure: Figure, words: str) -> str:
    """Return a figure as Markdown, with the words for readers who cannot see it."""
    drawn = io.BytesIO()
    figure.savefig(drawn, format="png", dpi=110)
    return f"![{words}](data:image/png;base64,{base64.b64encode(drawn.getvalue()).decode()})"
