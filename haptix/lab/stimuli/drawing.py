"""Pictures of drive files: one in detail, or a whole set on a sheet, without a contact model."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from haptix.base.errors import from_extra
from haptix.base.files import read_json, reading
from haptix.base.terminal import placeholder_note
from haptix.feel.signals.audio_files import Array, read_drive
from haptix.lab.stimuli.rendering import over_period
from haptix.lab.stimuli.sidecar import spectrum
from haptix.model.perception.thresholds import Perception, components_of_pull
from haptix.play.render.drive import SineCarrier

with from_extra("stimuli"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LONGEST_S = 10.0  # of a drawing
_ZOOM_PERIODS = 24
_MOST_ON_SHEET = 60


@dataclass(frozen=True)
class Drawn:
    """The start of a drive file, with the predictions of its sidecar."""

    table: dict[str, Any]
    t_s: Array
    drive_v: Array
    amplitude_t_s: Array
    amplitude_v: Array

    @property
    def mu(self) -> Array:
        """Predicted friction at `amplitude_t_s`."""
        against = self.table["predicted"]["against_amplitude"]
        return _of_square(self.amplitude_v, against["amplitude_v"], against["mu"])

    def band(self, known: Perception) -> tuple[Array, Array, str]:
        """Lowest and highest predicted friction, and a label of the band."""
        prediction = self.table["predicted"]
        against = prediction["against_amplitude"]
        if "mu_p5" in against:
            low, high = (
                _of_square(self.amplitude_v, against["amplitude_v"], against[name])
                for name in ("mu_p5", "mu_p95")
            )
            return low, high, "5 to 95 % of the fingers"
        error = prediction["error_mu_at_most"]
        return self.mu - error, self.mu + error, f"error of the surface, {error:.1e} at most"


def read_for_drawing(path: Path, length_s: float = _LONGEST_S) -> Drawn:
    """Read a drive file and its sidecar.

    Raises `FileFormatError` if either is missing, or the sidecar is not one of a set.
    """
    table = read_json(path.with_suffix(".json"))
    with reading(path.with_suffix(".json"), "the sidecar of a stimulus"):
        rate, carrier = float(table["sample_rate_hz"]), table["carrier_hz"]
        count = min(int(table["samples"]), round(length_s * rate))
        drive, _, _ = read_drive(path, float(table["full_scale_v"]), 0, count)
        if not table["predicted"]["against_amplitude"]["mu"]:
            raise KeyError("mu")
        t = np.arange(len(drive)) / rate
        if carrier is None or len(drive) < 2 * rate / carrier:
            period = max(1, round(rate / (carrier or table["drive_hz"])))
            return Drawn(table, t, drive, t, over_period(drive, period))
        at, amplitude = SineCarrier(float(carrier)).demodulate(drive, rate)
        return Drawn(table, t, drive, at / rate, np.abs(amplitude))


def draw_stimulus(path: str | Path, perception: Perception | None = None) -> bytes:
    """PNG of one drive file: waveform, spectrum, friction with its band, thresholds, audibility."""
    drawn = read_for_drawing(Path(path))
    with reading(Path(path).with_suffix(".json"), "the sidecar of a stimulus"):
        return _drawn(drawn, Perception.default() if perception is None else perception)


def _drawn(drawn: Drawn, known: Perception) -> bytes:
    table = drawn.table
    figure = Figure(figsize=(12, 8), layout="constrained")
    grid = figure.add_gridspec(3, 2)
    wave = figure.add_subplot(grid[0, 0])
    _outline(wave, drawn)
    _zoom(figure.add_subplot(grid[0, 1]), drawn)
    friction = figure.add_subplot(grid[1, :], sharex=wave)
    _friction(friction, drawn, known, labels=True)
    _spectrum(figure.add_subplot(grid[2, 0]), drawn, known)
    _thresholds(figure.add_subplot(grid[2, 1]), drawn, known)
    lines = f"{table['file']}: {_summary(table)}".split("\n")
    figure.suptitle("\n".join(fill(line, 130) for line in lines), fontsize=10)
    return _png(figure)


def contact_sheet(name: str, files: Sequence[Path], sidecars: Sequence[dict[str, Any]]) -> bytes:
    """PNG of a set: the amplitude and the predicted friction of every stimulus file."""
    known = Perception.default()
    shown = sidecars[:_MOST_ON_SHEET]
    columns = min(4, len(shown))
    rows = -(-len(shown) // columns)
    width, height = 3.4 * columns + 0.6, 2.2 * rows + 0.7
    figure = Figure(figsize=(width, height))
    # Margins in inches; a layout engine would take as long as the drawing.
    places = {
        "left": 0.7 / width, "right": 1 - 0.15 / width,
        "bottom": 0.5 / height, "top": 1 - 0.95 / height, "hspace": 0.6, "wspace": 0.25,
    }  # fmt: skip
    axes = figure.subplots(rows, columns, squeeze=False, gridspec_kw=places)
    for empty in axes.flat[len(shown) :]:
        empty.set_visible(False)
    for index, table in enumerate(shown):
        at = axes.flat[index]
        _friction(at, read_for_drawing(files[index], 3.0), known, labels=False)
        flag = ", audible" if table["audibility"]["audible"] else ""
        at.set_title(f"{table['name']} on {table['screen']}\n{table['peak_v']:.0f} V{flag}",
                     fontsize=8)  # fmt: skip
        at.tick_params(labelsize=7)
        at.set_ylabel("mu" if index % columns == 0 else "", fontsize=8)
        at.set_xlabel("s" if index >= len(shown) - columns else "", fontsize=8)
    rest = len(sidecars) - len(shown)
    more = f" (the first {len(shown)}; {rest} more)" if rest else ""
    placeholders = sorted({what for table in shown for what in table["placeholders"]})
    note = placeholder_note(placeholders)
    title = f"{name}{more}: predicted friction, band, and one JND (bar){note}"
    figure.suptitle(fill(title, round(14 * width)), fontsize=9, y=1 - 0.1 / height, va="top")
    return _png(figure)


def _summary(table: dict[str, Any]) -> str:
    heard, felt = table["audibility"], table["felt"]
    what = "AUDIBLE" if heard["audible"] else "not flagged as audible"
    level = "no threshold known" if felt is None or felt["sensation_db"] is None else (
        f"{felt['sensation_db']:+.1f} dB SL ({felt['channel']}"
        f"{', placeholder' if felt['threshold_is_placeholder'] else ''})"
    )  # fmt: skip
    lines = (
        f"{table['normal_force_n']:g} N, {table['fingers']} on {table['screen']}, peak "
        f"{table['peak_v']:.1f} V\n{level}; {what}: {heard['drive_hz']:.0f} Hz at "
        f"{heard['drive_current_a_rms'] * 1e6:.0f} µA rms"
    )
    if table["placeholders"]:
        lines += f"\nplaceholders, not measurements: {', '.join(table['placeholders'])}"
    return lines


def _outline(axes: Axes, drawn: Drawn) -> None:
    """Highest and lowest voltage in each of some hundreds of pieces."""
    size = max(1, len(drawn.drive_v) // 800)
    whole = len(drawn.drive_v) // size * size
    pieces = drawn.drive_v[:whole].reshape(-1, size)
    t = drawn.t_s[:whole:size]
    axes.fill_between(t, pieces.min(1), pieces.max(1), color="tab:purple", lw=0.5)
    ceiling = drawn.table["ceiling_v"]
    for sign in (-1, 1):
        axes.axhline(sign * ceiling, color="0.5", ls=":", lw=1)
    axes.set(xlabel="time (s)", ylabel="drive (V)", title="Drive and its ceiling (dotted)")


def _zoom(axes: Axes, drawn: Drawn) -> None:
    """A few periods where the drive is highest."""
    rate = drawn.table["sample_rate_hz"]
    period = rate / (drawn.table["drive_hz"] or 100.0)
    count = min(len(drawn.drive_v), round(_ZOOM_PERIODS * period))
    middle = int(np.abs(drawn.drive_v).argmax())
    first = max(0, min(middle - count // 2, len(drawn.drive_v) - count))
    part = slice(first, first + count)
    axes.plot(1e3 * drawn.t_s[part], drawn.drive_v[part], color="tab:purple", lw=0.9, marker=".",
              ms=2)  # fmt: skip
    axes.set(xlabel="time (ms)", ylabel="drive (V)", title="Samples about the highest voltage")


def _friction(axes: Axes, drawn: Drawn, known: Perception, labels: bool) -> None:
    low, high, what = drawn.band(known)
    t, mu = drawn.amplitude_t_s, drawn.mu
    axes.fill_between(t, low, high, color="tab:blue", alpha=0.25, lw=0, label=what)
    axes.plot(t, mu, color="tab:blue", lw=1, label="predicted")
    ground = drawn.table["predicted"]["mu_without_voltage"]
    step = known.difference_mu(ground)
    axes.errorbar(
        [t[0] - 0.02 * (t[-1] - t[0])], [ground + step / 2], [step / 2], color="tab:red", capsize=3,
        label=f"one JND, {step:.3f}",
    )  # fmt: skip
    reachable = drawn.table["predicted"]["mu_reachable"][1]
    axes.axhline(ground, color="0.6", ls="--", lw=0.8, label="without voltage")
    axes.axhline(reachable, color="0.6", ls=":", lw=0.8, label="highest reachable")
    if labels:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=5, fontsize=8)
        axes.set(ylabel="friction coefficient", title="Predicted friction")


def _spectrum(axes: Axes, drawn: Drawn, known: Perception) -> None:
    frequency, volts = spectrum(drawn.drive_v, drawn.table["sample_rate_hz"])
    low, high = known.audibility.low_hz, known.audibility.high_hz
    axes.axvspan(low, high, color="tab:orange", alpha=0.12, label="audible range")
    axes.plot(frequency[1:], np.maximum(volts[1:], 1e-6), color="tab:purple", lw=0.8)
    axes.set(
        xscale="log", yscale="log", xlim=(max(1.0, frequency[1]), frequency[-1]),
        ylim=(1e-3, 300), xlabel="frequency (Hz)", ylabel="amplitude (V)",
        title="Spectrum of the drive",
    )  # fmt: skip
    axes.legend(fontsize=8, loc="upper left")


def _thresholds(axes: Axes, drawn: Drawn, known: Perception) -> None:
    rate, pull_v = drawn.table["sample_rate_hz"], drawn.drive_v
    if drawn.table["carrier_hz"] is not None:
        pull_v = drawn.amplitude_v / np.sqrt(2)
        if len(drawn.amplitude_t_s) > 1:
            rate = 1 / float(np.mean(np.diff(drawn.amplitude_t_s)))
    components = components_of_pull(pull_v, rate, least_v=0.5)
    axes.plot([c.felt_hz for c in components], [20 * np.log10(c.drive_v) for c in components], ".",
              color="tab:purple", ms=4, label="components of the attraction")  # fmt: skip
    for channel, color in zip(known.channels, ("tab:green", "tab:olive", "0.5"), strict=False):
        label = f"threshold, {channel.name}{' (placeholder)' if channel.is_placeholder else ''}"
        axes.plot(channel.felt_hz, channel.threshold_db, color=color, label=label)
    axes.set(
        xscale="log", xlim=(1, 2000), ylim=(-10, 50), xlabel="felt frequency (Hz)",
        ylabel="equivalent sine drive (dB re 1 V)", title="Components and detection thresholds",
    )  # fmt: skip
    axes.legend(fontsize=8, loc="lower left")


def _of_square(at: Array, amplitude: Sequence[float], mu: Sequence[float]) -> Array:
    """Interpolate friction over the square of the amplitude."""
    return np.asarray(np.interp(np.square(at), np.square(amplitude), mu))


def _png(figure: Figure) -> bytes:
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=110)
    return file.getvalue()
