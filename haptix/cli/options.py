"""Options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from haptix.arguments import (
    is_there,
    material_file,
    number,
    numbers,
    one_of,
    preset_or_file,
    some_of,
)
from haptix.presets import FINGERS, SCREENS, TERMS

Image = Annotated[
    Path | None,
    typer.Option(
        help="Photograph, with its JSON beside it or --width-mm. [default: bricks]",
        callback=is_there,
    ),
]
MaterialFile = Annotated[
    Path | None,
    typer.Option(
        help="Material: TOML or JSON, or gallery:NAME, see `haptix material`; instead of a "
        "photograph.",
        callback=material_file,
    ),
]
FingerPath = Annotated[
    Path | None,
    typer.Option(
        help="CSV: t_s, x_mm, y_mm, normal_force_n. [default: a recorded path]", callback=is_there
    ),
]
NARROWEST_MM, WIDEST_MM = 0.1, 10_000.0
width = number(least=NARROWEST_MM, most=WIDEST_MM)
Width = Annotated[
    float | None, typer.Option(help="Width of the photograph on the screen.", callback=width)
]
Range = Annotated[
    str | None,
    typer.Option(
        help="LOW,HIGH friction coefficients. [default: what is reachable]",
        callback=numbers(is_range=True),
    ),
]
SurfaceFile = Annotated[
    Path | None,
    typer.Option(
        help="Surface of `haptix build`. [default: built for the path]", callback=is_there
    ),
]
finger_name, screen_name = preset_or_file("finger", FINGERS), preset_or_file("screen", SCREENS)
Finger = Annotated[
    str,
    typer.Option(
        help="Finger: a preset (dry, semi-wet, wet) or a TOML file.", callback=finger_name
    ),
]
Screen = Annotated[
    str, typer.Option(help="Screen: a preset (3m-sct3250) or a TOML file.", callback=screen_name)
]
OwnFinger = Annotated[
    str | None,
    typer.Option(
        help="Finger. [default: the device's installed profile, or semi-wet]", callback=finger_name
    ),
]
OwnScreen = Annotated[
    str | None,
    typer.Option(
        help="Screen. [default: the device's installed profile, or 3m-sct3250]",
        callback=screen_name,
    ),
]
positive = number(above=0)
delay_ms = number(least=0, most=1000)
CarrierHz = Annotated[
    float | None,
    typer.Option(help="Frequency of the carrier. [default: 4000]", callback=positive),
]
DirectHz = Annotated[
    float | None,
    typer.Option(help="Drive at this frequency, without a carrier.", callback=positive),
]
Waveform = Annotated[
    str,
    typer.Option(
        help="Waveform of the direct drive: sine or square.", callback=one_of("sine", "square")
    ),
]
ReactionMs = Annotated[
    float,
    typer.Option(help="From a touch to what it changes.", callback=number(above=0, most=1000)),
]
HorizonMs = Annotated[
    float,
    typer.Option(help="Longest stall that is not felt.", callback=number(above=0, most=10_000)),
]
Fidelity = Annotated[
    str,
    typer.Option(
        help="mean-field; closed-form: faster and coarser; boundary-element: the reference, slow.",
        callback=one_of("mean-field", "closed-form", "boundary-element"),
    ),
]
Theory = Annotated[
    str | None,
    typer.Option(
        help="Mean field: corrected by boundary elements, open-gaps or as-published; tau_f is "
        "carried over. [default: the finger's]",
        callback=one_of("corrected", "open-gaps", "as-published"),
    ),
]
Skin = Annotated[
    str | None,
    typer.Option(
        help="Skin dielectric: order-of-magnitude, gabriel-dry or gabriel-wet. [default: the "
        "finger's own]",
        callback=one_of("order-of-magnitude", "gabriel-dry", "gabriel-wet"),
    ),
]
With = Annotated[
    list[str] | None,
    typer.Option(
        "--with",
        help="Switch a term on, such as finite-size; may be repeated.",
        callback=some_of(*TERMS),
    ),
]
Without = Annotated[
    list[str] | None,
    typer.Option("--without", help="Switch a term off; may be repeated.", callback=some_of(*TERMS)),
]
_POSITIVE = numbers(above=0)
Force = Annotated[str, typer.Option(help="Normal forces [N], comma-separated.", callback=_POSITIVE)]
Voltage = Annotated[
    str, typer.Option(help="Amplitudes [V], comma-separated.", callback=numbers(least=0))
]
Frequency = Annotated[
    str | None,
    typer.Option(
        help="Drive frequencies [Hz]. Without them the skin is a conductor.", callback=_POSITIVE
    ),
]
Thickness = Annotated[
    str | None,
    typer.Option(
        help="d1/eps1 of the insulator [m]. [default: the screen's own]", callback=_POSITIVE
    ),
]
