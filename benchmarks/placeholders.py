"""What the waves beyond a measured band do to area, attraction and friction.

    python benchmarks/placeholders.py

The roughness of the semi-wet finger is cut off at a wavenumber, as a measurement that ends there
has it; the rest of its spectrum stays as it is. Ratios are with all waves over without those
beyond, at 0.5 N, h0 = 0.2 um and a voltage of 200 V.
"""

from __future__ import annotations

import torch

from haptix import ContactModel, Finger, Screen
from haptix.model.contact import RoughnessSpectrum
from haptix.model.finger import MeasuredRoughness

ENDS_PER_M = (1e5, 1e6, 1e7, 1e8)  # waves of 63 um to 63 nm


def main() -> None:
    """Print the table."""
    finger, screen = Finger.preset("semi-wet"), Screen.preset("3m-sct3250")
    whole = finger.roughness.spectrum()
    voltage = torch.tensor([0.0, 200.0], dtype=torch.float64)

    def solve(spectrum: RoughnessSpectrum) -> torch.Tensor:
        """Area without voltage, attraction of the gaps and mu_on/mu_off."""
        cut = finger.replace(roughness=MeasuredRoughness.of(spectrum))
        state = ContactModel(cut, screen).solve(0.5, voltage, h0_m=2e-7)
        return torch.stack(
            [state.area_fraction[0], state.gap_attraction_pa[1], state.mu[1] / state.mu[0]]
        )

    everything = solve(whole)
    print("waves up to   area   attraction   mu_on/mu_off without the rest, with it")
    for end in ENDS_PER_M:
        inside = whole.wavenumber < end
        last = torch.tensor([end], dtype=torch.float64)
        nodes = torch.cat([whole.wavenumber[inside], last])
        without = solve(RoughnessSpectrum(nodes, whole(nodes)))
        area, attraction, _ = (everything / without).tolist()
        print(
            f"{end:8.0e} /m  {area:6.2f}   {attraction:6.2f}       "
            f"{float(without[2]):5.2f}   {float(everything[2]):5.2f}"
        )


if __name__ == "__main__":
    main()
