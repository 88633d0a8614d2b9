"""The certificate of a calibration: a PDF of one page, with an appendix of its evidence."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import timedelta
from io import BytesIO
from pathlib import Path
from textwrap import wrap

import numpy as np

from calibration.fit import Fit
from calibration.recording import StrokeRecording
from calibration.rig import RigCheck
from calibration.session import Instruments
from calibration.verification import Verification
from haptix.errors import InputError, from_extra
from haptix.files import write_whole
from haptix.finger import Finger
from haptix.pair import described
from haptix.report import row
from haptix.screen import CALIBRATION_VALID_DAYS, Screen
from haptix.version import __version__

with from_extra("calibration"):
    from matplotlib import rc_context
    from matplotlib.backends.backend_pdf import PdfPages
    from matplotlib.figure import Figure

CERTIFICATE = "certificate.pdf"
_A4 = 8.27, 11.69
_LEFT, _RIGHT, _TOP, _BOTTOM = 0.08, 0.92, 0.95, 0.06
_LINE = 0.0155  # of the page's height
_COLUMNS = 108  # characters of a line


class _Page:
    """Pages written from the top down; a full page is followed by a new one."""

    def __init__(self, pages: PdfPages, footer: str) -> None:
        self._pages, self._footer = pages, footer
        self.count = 0
        self._figure: Figure | None = None
        self._y = 0.0

    def begin(self) -> None:
        """Begin a new page."""
        self.end()
        self.count += 1
        self._figure, self._y = Figure(figsize=_A4), _TOP

    def end(self) -> None:
        """Keep the page that is written."""
        if self._figure is not None:
            foot = f"{self._footer}, page {self.count}"
            self._figure.text(_LEFT, _BOTTOM / 2, foot, size=7, color="#555")
            self._pages.savefig(self._figure)  # type: ignore[no-untyped-call]
            self._figure = None

    def line(self, cells: Sequence[tuple[float, str]], size: float = 8, bold: bool = False) -> None:
        """Write texts at shares of the width, on one line."""
        if self._y < _BOTTOM or self._figure is None:
            self.begin()
        assert self._figure is not None
        for at, text in cells:
            x = _LEFT + at * (_RIGHT - _LEFT)
            weight = "bold" if bold else "normal"
            shown = text.replace("$", r"\$")  # no formulas
            self._figure.text(x, self._y, shown, size=size, va="top", weight=weight)
        self._y -= _LINE * max(size / 8, 1.0)

    def space(self, lines: float = 0.6) -> None:
        """Leave some room."""
        self._y -= lines * _LINE

    def heading(self, text: str) -> None:
        """Write a heading."""
        self.space()
        self.line([(0, text)], 10, bold=True)

    def pairs(self, rows: Iterable[tuple[str, str]]) -> None:
        """Write names and their values; long values are wrapped."""
        for name, what in rows:
            for number, text in enumerate(wrap(what, _COLUMNS - 26) or [""]):
                self.line([(0, "" if number else name), (0.22, text)])

    def table(self, rows: Sequence[dict[str, str]]) -> None:
        """Write rows below their headings, as wide as their texts."""
        if not rows:
            return
        heads = list(rows[0])
        widths = np.array([max(len(h), *(len(r[h]) for r in rows)) + 1.5 for h in heads])
        starts = np.concatenate([[0], np.cumsum(widths)[:-1]]) / max(widths.sum(), _COLUMNS)
        size = min(8.0, 8.0 * _COLUMNS / widths.sum())
        self.line(list(zip(starts, heads, strict=True)), size, bold=True)
        for cells in rows:
            self.line(list(zip(starts, cells.values(), strict=True)), size)


def write_certificate(
    path: Path,
    screen: Screen,
    finger: Finger,
    fit: Fit,
    verification: Verification,
    recordings: Sequence[StrokeRecording],
    instruments: Instruments,
    rig: RigCheck | None = None,
) -> str:
    """Write the certificate of a verified profile, and return its number.

    Raises
    ------
    InputError
        If the verification failed, or an instrument did not hold on the day of a stroke.
    """
    made = screen.calibration
    if made is None or verification.failures:
        why = "; ".join(verification.failures) or "the screen has no calibration"
        raise InputError(f"expected a calibration that passed, or is provisional: {why}")
    instruments.check_strokes(recordings)
    number = f"{made.date:%Y%m%d}-{screen.calibration_id[:8]}"
    about = described(finger, screen)
    rooms = [recording.conditions for recording in recordings]
    drivers = {conditions.instruments.get("driver", "") for conditions in rooms} - {""}
    used = {tuple(pair) for conditions in rooms for pair in conditions.instruments.items()}
    shown = [
        instrument
        for instrument in instruments.instruments
        if (instrument.name, instrument.serial) in used
    ]
    content = BytesIO()
    metadata = {"Title": f"Certificate {number}", "Creator": "haptix", "CreationDate": None}
    with rc_context({"pdf.fonttype": 42}), PdfPages(content, metadata=metadata) as pages:
        sheet = _Page(pages, f"Certificate {number} of {screen.name}")
        sheet.begin()
        practice = ": a practice, of no screen" if made.is_virtual else ""
        sheet.line([(0, f"Certificate of calibration{practice}")], 16, bold=True)
        sheet.space()
        sheet.pairs(
            [
                ("Number", number),
                ("Panel", screen.name),
                ("Finger", f"{about['finger']} ({about['pair']})"),
                ("Driver", ", ".join(sorted(drivers)) or "not named"),
                ("Operator", made.operator or "not named"),
                ("Measured on", f"{made.date}"),
                ("Due on", f"{made.date + timedelta(days=CALIBRATION_VALID_DAYS)}"),
                ("Environment", environment(recordings)),
                ("Software", f"haptix {__version__}, theory {fit.theory}"),
            ]
        )
        sheet.heading(f"Verdict: {verification.verdict}")
        sheet.pairs(
            [
                ("Friction", f"within {verification.bound_jnd:.2f} just-noticeable differences "
                 f"(JND, 11 %) at most; {verification.tolerance_jnd:g} are allowed"),
                ("Contrast mu(V)/mu(0)", verification.contrast_text),
                ("Verified for", "nothing" if made.verified is None else made.verified.text),
                *(("Not tested", text) for text in verification.untested),
            ]
        )  # fmt: skip
        sheet.heading("Results, with intervals of 90 %")
        sheet.table([row(budget) for budget in verification.budget])
        sheet.heading("Instruments")
        sheet.table([row(instrument) for instrument in shown])
        if rig is not None:
            day = "on a day that is not known" if rig.measured_on is None else f"{rig.measured_on}"
            sheet.pairs([("Rig checked", f"{day}, with {', '.join(rig.instruments)}")])
        sheet.heading("Signature")
        sheet.space(3)
        sheet.line([(0, "_" * 40), (0.5, "_" * 40)])
        sheet.line([(0, "name"), (0.5, "date and signature")], 7)
        sheet.begin()
        sheet.line([(0, "Appendix")], 14, bold=True)
        for budget in verification.budget:
            sheet.heading(f"Uncertainty budget of {budget.quantity}")
            cells = [row(part) for part in budget.main]
            sheet.table([{k: v for k, v in cell.items() if k != "quantity"} for cell in cells])
        sheet.heading("Errors of friction, by the strokes kept out of the fit")
        sheet.table([row(group) for group in verification.groups])
        sheet.pairs([("Steadiness", verification.steadiness.text)])
        sheet.pairs([(fit.shear, fit.shear_note)])
        sheet.heading("Rests on")
        sheet.pairs([("", text) for text in made.rests_on])
        sheet.heading("Hashes (SHA-256)")
        sheet.pairs([("screen.toml", screen.content_hash()), ("finger.toml", made.finger_hash),
                     ("fit.json", fit.content_hash)])  # fmt: skip
        sheet.pairs([(name, digest) for name, digest in sorted(fit.made_from.items())
                     if not name.startswith("strokes/")])  # fmt: skip
        sheet.pairs([("strokes", f"{len(recordings)} files, named with their hashes in fit.json")])
        sheet.end()
    write_whole(path, content.getvalue())
    return number


def environment(recordings: Sequence[StrokeRecording]) -> str:
    """Return the room's temperature and humidity, where recorded."""
    said = []
    for name, unit in (("temperature_c", "°C"), ("humidity_percent", "%")):
        read = [getattr(recording.conditions, name) for recording in recordings]
        values = [value for value in read if value is not None]
        word = name.split("_")[0]
        if not values:
            said.append(f"{word} not recorded")
        elif min(values) == max(values):
            said.append(f"{word} {values[0]:.3g} {unit}")
        else:
            said.append(f"{word} {min(values):.3g} to {max(values):.3g} {unit}")
    return ", ".join(said)
