"""Reachable friction with and without breakdown: the tables and the figure of docs/breakdown.md.

    python benchmarks/breakdown.py [--out docs/breakdown.md]

The semi-wet finger on the paper's screen at 0.5 N, without more than a model's default terms, with
`field-limit`, and with `body-return` for one finger and two.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch
from matplotlib.figure import Figure

from haptix import ContactModel, Finger, Screen
from haptix.model.perception.thresholds import WEBER_FRACTION

FORCE_N = 0.5
VOLTS = torch.tensor([50.0, 100.0, 150.0, 200.0], dtype=torch.float64)
FREQUENCIES_HZ = (125.0, 4000.0)
FINGER, SCREEN = Finger.preset("semi-wet"), Screen.preset("3m-sct3250")

HEAD = """# Past what gaps bear

Made by `python benchmarks/breakdown.py`. {finger} finger on {screen}, {force:g} N, theory
`{theory}`. Past: share of the attraction from gaps whose field is past what they bear
(`state.pull_past_breakdown`). A surface ends at breakdown only with the term `breakdown`; what is
reachable up to there is in the last column. Under `field-limit` discharge holds each gap at what it
bears. Both rest on 350 V/um for gaps under 3 um, and on a roughness that is a placeholder.

![Friction against voltage](breakdown.png)

"""


def model(*terms: str, fingers: int = 1, body_f: float = 150e-12) -> ContactModel:
    finger = FINGER.replace(fingers_on_screen=fingers)
    screen = SCREEN.replace(body_capacitance_f=body_f)
    return ContactModel(finger, screen, terms=dict.fromkeys(terms, True))


def reachable(free: ContactModel, held: ContactModel, frequency_hz: float) -> list[str]:
    """Rows of the first table."""
    rest, on = free.solve(FORCE_N, 0.0, frequency_hz), free.solve(FORCE_N, VOLTS, frequency_hz)
    limited = held.solve(FORCE_N, VOLTS, frequency_hz).mu / rest.mu
    ratio, end = on.mu / rest.mu, rest.breakdown_voltage_v
    up_to = free.solve(FORCE_N, VOLTS.clamp(max=float(end)), frequency_hz).mu / rest.mu
    columns = (VOLTS, on.pull_past_breakdown, ratio, limited, (ratio / limited).log(), up_to)
    return [
        f"| {frequency_hz:g} Hz | {volts:g} V | {past:.0%} | {one:.3f} | {other:.3f} | "
        f"{apart / WEBER_FRACTION:.1f} | {least:.3f}, to {min(volts, float(end)):.0f} V |"
        for volts, past, one, other, apart, least in zip(
            *(column.tolist() for column in columns), strict=True
        )
    ]


def circuit() -> list[str]:
    """Rows of the table of the body's return."""
    rows = []
    for fingers in (1, 2):
        for body_f in (100e-12, 150e-12):
            closed = model("body-return", fingers=fingers, body_f=body_f)
            cells = []
            for frequency_hz in FREQUENCIES_HZ:
                off = closed.solve(FORCE_N, 0.0, frequency_hz)
                on = closed.solve(FORCE_N, VOLTS[-1], frequency_hz)
                free = model().solve(FORCE_N, VOLTS[-1], frequency_hz)
                left = free.breakdown_voltage_v / on.breakdown_voltage_v
                assert on.current_a is not None
                cells.append(
                    f"{float(left):.3f}, {float(on.mu / off.mu):.3f}, "
                    f"{float(on.current_a) * fingers * 1e3:.3f} mA"
                )
            rows.append(f"| {fingers} | {body_f * 1e12:g} pF | " + " | ".join(cells) + " |")
    return rows


def draw(free: ContactModel, held: ContactModel, file: Path) -> None:
    figure = Figure(figsize=(9, 3.8), layout="constrained")
    volts = torch.linspace(0, 200, 81, dtype=torch.float64)
    for axes, frequency in zip(figure.subplots(1, 2, sharey=True), FREQUENCIES_HZ, strict=True):
        for found, label in ((free, "no limit"), (held, 'with "field-limit"')):
            mu = found.solve(FORCE_N, volts, frequency).mu
            axes.plot(volts, mu / mu[0], label=label)
        end = float(free.solve(FORCE_N, 0.0, frequency).breakdown_voltage_v)
        axes.axvline(end, color="0.5", ls=":", label="breakdown")
        axes.set(title=f"{frequency:g} Hz", xlabel="amplitude (V)")
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylabel("friction over that without voltage")
    figure.axes[0].legend()
    figure.savefig(file, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/breakdown.md"))
    out = parser.parse_args().out
    free, held = model(), model("field-limit")
    lines = [
        "| drive | amplitude | past | mu_on/mu_off | with `field-limit` | apart (JND) "
        "| up to breakdown |",
        "|---|---|---|---|---|---|---|",
    ]
    for frequency_hz in FREQUENCIES_HZ:
        lines += reachable(free, held, frequency_hz)
    rest = free.solve(FORCE_N, 0.0, FREQUENCIES_HZ[1])
    lines += [
        "",
        "## The body's return",
        "",
        f"The contact has {float(rest.capacitance_f) * 1e12:.1f} pF at rest. Share of the voltage "
        "that is left, mu_on/mu_off and the amplitude of the current through the person, at 200 V, "
        "with the term `body-return`:",
        "",
        "| fingers | body | " + " | ".join(f"{f:g} Hz" for f in FREQUENCIES_HZ) + " |",
        "|---|---|---|---|",
        *circuit(),
    ]
    head = HEAD.format(finger=FINGER.name, screen=SCREEN.name, force=FORCE_N, theory=free.theory)
    out.write_text(head + "\n".join(lines) + "\n")
    draw(free, held, out.with_suffix(".png"))


if __name__ == "__main__":
    main()
