"""One photograph, one stroke: the friction that it asks for, and what the finger feels.

    python examples/photograph_to_friction.py [photograph.png] [--out picture.png]

The README's picture is made by `--out docs/photograph-to-friction.png`. Its letters can be read at
half its size, 420 pixels.
"""

import argparse

import numpy as np

import haptix
from haptix.play import Setting, simulate

try:
    from matplotlib.figure import Figure
    from skimage.data import brick
    from skimage.io import imread
except ModuleNotFoundError as error:
    raise SystemExit(
        f"needs {error.name}; run: pip install 'haptix-electrovibration[figures]'"
    ) from None

WIDTH_MM, AT_MM = 60.0, 24.0  # of the photograph; the stroke's height in it
FORCE_N, SPEED_MM_PER_S, CARRIER_HZ = 0.5, 60.0, 4000.0


def main(photograph: str | None = None, out: str = "photograph-to-friction.png") -> None:
    picture = imread(photograph) if photograph else brick()
    texture = haptix.Texture.from_image(picture, width_mm=WIDTH_MM)
    t_s = np.arange(0.0, (WIDTH_MM - 6) / SPEED_MM_PER_S, 0.01)
    stroke = haptix.Trajectory(
        t_s, 3 + SPEED_MM_PER_S * t_s, np.full_like(t_s, AT_MM), np.full_like(t_s, FORCE_N)
    )
    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    surface = haptix.FrictionSurface.build(
        model, {"normal_force_n": (FORCE_N / 2, 2 * FORCE_N), "frequency_hz": CARRIER_HZ}
    )
    simulation = simulate(Setting(model, texture, stroke), surface)
    felt = simulation.felt

    figure = Figure(figsize=(4.2, 3.6), layout="constrained")
    above, below = figure.subplots(2, sharex=True, height_ratios=(1, 1.1))
    above.imshow(picture, cmap="gray", extent=(0, WIDTH_MM, texture.height_mm, 0))
    above.set(yticks=[], ylim=(AT_MM + 10, AT_MM - 10), aspect="auto")
    above.annotate(
        "", (felt.x_mm[-1], AT_MM), (felt.x_mm[0], AT_MM),
        arrowprops={"arrowstyle": "-|>", "color": "tab:red", "lw": 2.5},
    )  # fmt: skip
    above.set_title("a photograph and one stroke over it", fontsize=11)
    below.plot(felt.x_mm, simulation.target_mu, color="tab:orange", lw=4, label="wanted")
    below.plot(felt.x_mm, felt.mu, color="tab:blue", lw=1.2, label="felt")
    below.set(xlabel="place (mm)", ylabel="friction", xlim=(0, WIDTH_MM))
    below.set_ylim(top=felt.mu.max() + 0.3 * (felt.mu.max() - felt.mu.min()))
    below.legend(loc="upper center", ncols=2, frameon=False)
    figure.savefig(out, dpi=200)
    print(f"felt within {simulation.evaluation.error_p95_jnd:.2g} JND of what was wanted")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("photograph", nargs="?")
    parser.add_argument("--out", default="photograph-to-friction.png")
    asked = parser.parse_args()
    main(asked.photograph, asked.out)
