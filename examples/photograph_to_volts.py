"""Render a photograph under a finger, with the parts in plain sight.

    python examples/photograph_to_volts.py [photograph.png]

`haptix demo` does the same and evaluates the result; this is the shortest complete program.
"""

import sys

import haptix
from haptix.play import FINGER_PATH

try:
    from skimage.data import brick
except ModuleNotFoundError as error:
    sys.exit(f"needs {error.name}; run: pip install 'haptix-electrovibration[figures]'")

CARRIER_HZ = 4000.0


def main() -> None:
    photograph = sys.argv[1] if len(sys.argv) > 1 else brick()

    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    path = haptix.Trajectory.from_csv(FINGER_PATH)
    force = path.normal_force_n
    surface = haptix.FrictionSurface.build(
        model, {"normal_force_n": (force.min(), force.max()), "frequency_hz": CARRIER_HZ}
    )
    texture = haptix.Texture.from_image(photograph, width_mm=60)
    device = haptix.open_device("mock:")

    with haptix.Renderer(surface, texture, device) as renderer:
        for touch in zip(path.t_s, path.x_mm, path.y_mm, path.normal_force_n, strict=True):
            renderer.touch(*touch)

    driver = device.mock
    assert driver is not None  # other links have none
    print(f"{driver.samples_played} samples played, peak {abs(driver.played_v).max():.1f} V")
    print(
        f"ends at {driver.played_v[-1]:g} V, {driver.faults} faults, {driver.underruns} underruns"
    )


if __name__ == "__main__":
    main()
