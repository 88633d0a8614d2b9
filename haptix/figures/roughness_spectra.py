"""The finger's roughness spectrum, and others that the paper's three numbers fit as well."""

from __future__ import annotations

import numpy as np
import torch

from haptix.contact import RoughnessSpectrum
from haptix.figures.data import COLD_TO_HOT, Curve, FigureData, Panel, numbers
from haptix.finger import Finger, Roughness

PLACEHOLDERS = (
    Roughness(q1_per_m=1e8, q_rolloff_per_m=5981.5),
    Roughness(q1_per_m=1e7, q_rolloff_per_m=9142.0),
)
"""The other two of the physics page, section 3."""

_PER_DECADE = 60


def roughness_spectra(finger: Finger | None = None) -> FigureData:
    """C(q) and the rms slope of the waves up to q, for the finger and two other placeholders.

    Parameters
    ----------
    finger : Finger, optional
        Whose roughness to show first; the semi-wet finger without.
    """
    finger = finger or Finger.preset("semi-wet")
    shown = (finger.roughness, *PLACEHOLDERS)
    spectra = [roughness.spectrum() for roughness in shown]
    wavenumber = _wavenumbers(spectra)
    columns = {"wavenumber_per_m": wavenumber}
    densities, slopes = [], []
    names = ("finger", *(f"placeholder_q1_1e{np.log10(s.q1_per_m):.0f}" for s in PLACEHOLDERS))
    colors = ("black", COLD_TO_HOT[0], COLD_TO_HOT[4])
    for spectrum, name, color in zip(spectra, names, colors, strict=True):
        inside = (wavenumber >= spectrum.q0) & (wavenumber <= spectrum.q1)
        q = torch.from_numpy(wavenumber[inside])
        density = np.full_like(wavenumber, np.nan)
        density[inside] = numbers(spectrum(q))
        slope = np.full_like(wavenumber, np.nan)
        rest = spectrum.moment(3) - spectrum.moment(3, q)
        slope[inside] = numbers(rest.clamp(min=0.0).sqrt())
        columns[f"c_{name}_m4"], columns[f"rms_slope_up_to_q_{name}"] = density, slope
        which = finger.name if name == "finger" else "other"
        label = (
            f"{which}: $q_\\mathrm{{r}}$ = {spectrum.q_rolloff:.0f} /m,\n"
            f"$q_\\mathrm{{1}}$ = $\\mathrm{{10}}^{{{np.log10(spectrum.q1):.3g}}}$ /m"
        )
        style, width = ("-", 2.2) if name == "finger" else ("--", 1.6)
        densities.append(Curve("wavenumber_per_m", f"c_{name}_m4", "", color, style, width))
        slopes.append(
            Curve("wavenumber_per_m", f"rms_slope_up_to_q_{name}", label, color, style, width)
        )
    first = shown[0]
    caption = (
        f"Left: roughness power spectrum of the {finger.name} finger (black) and of two others "
        f"that have the same root-mean-square height ({float(spectra[0].h_rms_m) * 1e6:.4g} µm), "
        f"slope ({float(spectra[0].slope_rms):.2f}) and Hurst exponent "
        f"({PLACEHOLDERS[0].hurst:g}) within rounding, but end at "
        "other wavenumbers q1. Right: root-mean-square slope of the waves longer than 2π/q. "
        "Convention: h_rms² = 2π ∫ q C dq. "
        + (
            "Placeholders, not measured: all three spectra; the measured one is printed as a "
            "figure only. "
            if first.is_placeholder
            else "The two others are placeholders, the finger's own is measured. "
        )
        + "No contact is solved here, so that neither its terms nor contact spots enter."
    )
    q_range = (wavenumber[0] / 2, wavenumber[-1] * 2)
    return FigureData(
        name="roughness",
        title="Roughness of the finger and of two placeholders",
        caption=caption,
        columns=columns,
        panels=(
            Panel(
                "wavenumber $q$ (1/m)",
                "$C(q)$ (m$^4$)",
                tuple(densities),
                x_scale="log",
                y_scale="log",
                x_range=q_range,
                has_legend=False,
            ),
            Panel(
                "wavenumber $q$ (1/m)",
                "rms slope up to $q$",
                tuple(slopes),
                x_scale="log",
                x_range=q_range,
                y_range=(0, 1),
                legend_title="spectrum",
            ),
        ),
    )


def _wavenumbers(spectra: list[RoughnessSpectrum]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Evenly spaced in the logarithm, with the bends of every spectrum among them."""
    low, high = min(s.q0 for s in spectra), max(s.q1 for s in spectra)
    even = np.geomspace(low, high, round(_PER_DECADE * np.log10(high / low)) + 1)
    bends = np.concatenate([numbers(s.wavenumber) for s in spectra])
    # Bends take the place of neighbours that differ by rounding only.
    apart = np.abs(even[:, None] / bends - 1).min(axis=1) > 1e-9
    return np.unique(np.concatenate([even[apart], bends]))
