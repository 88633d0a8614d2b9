"""The finger's roughness spectrum, and others that the paper's three numbers fit as well."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch

from haptix.contact import RoughnessSpectrum
from haptix.figures.data import COLD_TO_HOT, Array, FigureData, numbers
from haptix.finger import Finger, Roughness

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PLACEHOLDERS = (
    Roughness(q1_per_m=1e8, q_rolloff_per_m=5981.5),
    Roughness(q1_per_m=1e7, q_rolloff_per_m=9142.0),
)
"""The other two of the physics page, section 3."""

_COLORS = ("black", COLD_TO_HOT[0], COLD_TO_HOT[4])
_PER_DECADE = 60


def roughness_spectra(finger: Finger | None = None) -> FigureData:
    """C(q) and the rms slope of the waves up to q, for a finger and two placeholders.

    The finger is the semi-wet one unless another is given.
    """
    finger = finger or Finger.preset("semi-wet")
    names = ("finger", *(f"placeholder_q1_1e{np.log10(p.q1_per_m):.0f}" for p in PLACEHOLDERS))
    roughnesses = (finger.roughness, *PLACEHOLDERS)
    spectra = {n: r.spectrum() for n, r in zip(names, roughnesses, strict=True)}
    wavenumber = _wavenumbers(list(spectra.values()))
    columns = {"wavenumber_per_m": wavenumber}
    for name, spectrum in spectra.items():
        inside = (wavenumber >= spectrum.q0) & (wavenumber <= spectrum.q1)
        q = torch.from_numpy(wavenumber[inside])
        rest = spectrum.moment(3) - spectrum.moment(3, q)
        for column, values in (
            (f"c_{name}_m4", spectrum(q)),
            (f"rms_slope_up_to_q_{name}", rest.clamp(min=0.0).sqrt()),
        ):
            columns[column] = np.full_like(wavenumber, np.nan)
            columns[column][inside] = numbers(values)

    def plot(left: Axes, right: Axes) -> None:
        for (name, spectrum), color in zip(spectra.items(), _COLORS, strict=True):
            which, style, width = "other", "--", 1.6
            if name == "finger":
                which, style, width = finger.name, "-", 2.2
            label = (
                f"{which}: $q_\\mathrm{{r}}$ = {spectrum.q_rolloff:.0f} /m,\n"
                f"$q_\\mathrm{{1}}$ = $\\mathrm{{10}}^{{{np.log10(spectrum.q1):.3g}}}$ /m"
            )
            for axes, column in ((left, f"c_{name}_m4"), (right, f"rms_slope_up_to_q_{name}")):
                axes.plot(wavenumber, columns[column], style, color=color, lw=width,
                          zorder=2 + width / 10, label=label)  # fmt: skip
        for axes in (left, right):
            axes.set(xlabel="wavenumber $q$ (1/m)", xscale="log")
            axes.set_xlim(wavenumber[0] / 2, wavenumber[-1] * 2)
        left.set(ylabel="$C(q)$ (m$^4$)", yscale="log")
        right.set(ylabel="rms slope up to $q$", ylim=(0, 1))

    shown = spectra["finger"]
    measured = (
        "Placeholders, not measured: all three spectra; the measured one is printed as a "
        "figure only."
        if finger.roughness.is_placeholder
        else "The two others are placeholders, the finger's own is measured."
    )
    caption = (
        f"Left: roughness power spectrum of the {finger.name} finger (black) and of two others "
        f"that have the same root-mean-square height ({float(shown.h_rms_m) * 1e6:.4g} µm), "
        f"slope ({float(shown.slope_rms):.2f}) and Hurst exponent ({PLACEHOLDERS[0].hurst:g}) "
        "within rounding, but end at other wavenumbers q1. Right: root-mean-square slope of the "
        f"waves longer than 2π/q. Convention: h_rms² = 2π ∫ q C dq. {measured} No contact is "
        "solved here, so that neither its terms nor contact spots enter."
    )
    title = "Roughness of the finger and of two placeholders"
    return FigureData("roughness", title, caption, columns, plot, (1, 2), "spectrum")


def _wavenumbers(spectra: list[RoughnessSpectrum]) -> Array:
    """Evenly spaced in the logarithm, with the bends of every spectrum among them."""
    low, high = min(s.q0 for s in spectra), max(s.q1 for s in spectra)
    even = np.geomspace(low, high, round(_PER_DECADE * np.log10(high / low)) + 1)
    bends = np.concatenate([numbers(s.wavenumber) for s in spectra])
    # Bends take the place of neighbours that differ by rounding only.
    apart = np.abs(even[:, None] / bends - 1).min(axis=1) > 1e-9
    return np.unique(np.concatenate([even[apart], bends]))
