"""Calibrate one screen, all the way, and use the profile.

    python examples/calibrate_screen.py [folder]

The finger is a virtual one, and its screen's insulator is 40 % thicker than assumed. For a real
finger replace `VirtualFingerSource` by `calibration.open_inputs("inputs.toml")`, the device by
`haptix.open_device("usb:")`, and prompt the person in the `Watcher`.
"""

import sys
import tempfile
from pathlib import Path

import haptix
from calibration import Parameters, Session, SessionInfo, StrokePredictor, measure, short_protocol
from calibration.keep.practice import VirtualFingerSource
from calibration.measure.measuring import Watcher
from calibration.steps import fit_folder, reduce_folder, verify_folder


def main() -> None:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp()) / "panel-7"

    print("takes about 1 minute, on a slow machine 5 minutes; strokes are told one by one")

    # The assumed finger and screen, from which the fit starts.
    finger = haptix.Finger.preset("semi-wet")
    screen = haptix.Screen.preset("3m-sct3250").replace(name="panel 7")
    truth = screen.replace(insulator_thickness_m=1.4e-6)

    # Plan: three minutes of strokes, chosen for their information.
    predictor = StrokePredictor(haptix.ContactModel(finger, screen))
    protocol = short_protocol(predictor, Parameters.of(finger, screen), minutes=3.0)

    # Measure: every stroke is on disk before the next starts.
    info = SessionInfo(screen=screen, finger=finger, operator="example")
    session = Session.begin(folder, protocol, info)
    source = VirtualFingerSource(haptix.ContactModel(finger, truth), seed=7)
    watcher = Watcher(done=lambda stroke, wrong: print(stroke.label, *wrong, sep="; "))
    device = haptix.open_device("mock:")
    outcome = measure(session, source, device, watcher)
    device.close()
    print(f"{outcome.accepted} strokes accepted, {outcome.rejected} repeated")

    # Reduce, fit, verify: each can be repeated on the same folder.
    reduce_folder(folder)
    fit, needs = fit_folder(folder)
    for one in fit.estimates:
        value = "not determined" if one.value is None else f"{one.value:.3g}"
        print(f"{one.name:28} {value:>15}  {one.low:.3g} to {one.high:.3g}  {one.verdict}")
    for need in needs:
        print(f"term {need.term}: {need.need}")
    verification, _ = verify_folder(folder)
    print(verification.verdict, *verification.failures, *verification.untested, sep="; ")

    # Use it.
    calibrated = haptix.Screen.load(folder / "screen.toml")
    print(
        f"d1/eps1 believed {screen.h0_m * 1e9:.1f} nm, true {truth.h0_m * 1e9:.1f} nm, "
        f"found {calibrated.h0_m * 1e9:.1f} nm; everything is in {folder}"
    )


if __name__ == "__main__":
    main()
