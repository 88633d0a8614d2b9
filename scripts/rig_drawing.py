"""Draw the rig with a Pico: ``python scripts/rig_drawing.py`` writes docs/rig.svg; needs schemdraw.

Docs show the file, which git keeps, so that nobody needs schemdraw to read them.
"""

from pathlib import Path

import schemdraw
from schemdraw import flow

OUT = Path(__file__).parents[1] / "docs" / "rig.svg"
PARTS = (
    ("host", "host\n(USB)"),
    ("pico", "Pico\nGP2, 3, 5: SPI\nGP6: enable\nGP26: monitor"),
    ("converter", "converter\n12 or 16 bits,\n0 V in its middle"),
    ("amplifier", "amplifier\nx50 to x100,\nenable"),
    ("resistors", "2 x 150 kOhm,\n250 V, in series"),
    ("panel", "panel\nconductor under\nits insulator"),
)


def main() -> None:
    """Draw boxes from the host to the panel, with the ways back that end at 0 V."""
    with schemdraw.Drawing(file=str(OUT), show=False) as drawing:
        drawing.config(fontsize=10, unit=1)
        boxes = {}
        for name, text in PARTS:
            boxes[name] = drawing.add(flow.Box(w=3.2, h=2.2).label(text).anchor("W"))
            if name != "panel":
                drawing.add(flow.Arrow().right().length(0.8).at(boxes[name].E))
        comparator = flow.Box(w=3.2, h=2.2).at((boxes["amplifier"].S[0], -4.2)).anchor("N")
        comparator = drawing.add(comparator.label("100:1 divider,\nwindow of +-2.1 V,\nlatch"))
        gate = flow.Box(w=3.2, h=2.2).at((boxes["converter"].S[0], -4.2)).anchor("N")
        gate = drawing.add(gate.label("AND, interlock,\n4.7 kOhm to\nground"))
        drawing.add(
            flow.Arrow().at(boxes["amplifier"].S).to(comparator.N).label("monitor", "right")
        )
        drawing.add(flow.Arrow().at(comparator.W).to(gate.E))
        drawing.add(flow.Wire("|-", arrow="->").at(boxes["pico"].S).to(gate.W).label("GP6", "left"))
        up = (boxes["amplifier"].S[0] - 1.0, boxes["amplifier"].S[1])
        drawing.add(flow.Wire("|-", k=1).at((gate.N[0] + 0.8, gate.N[1])).to((up[0], -2.6)))
        drawing.add(flow.Arrow().at((up[0], -2.6)).to(up).label("enable", "left"))


if __name__ == "__main__":
    main()
