"""Textures: the friction that a place on the screen should have.

Everything that can be felt is a `FrictionField`. The renderer asks it one thing, for a block of the
finger's path at a time::

    footprint_mm = speed_mm_per_s / envelope_rate_hz      # one number for the block: its largest
    value = field.friction(x_mm, y_mm, footprint_mm)       # float64, of the shape of x_mm and y_mm
    mu = as_mu(field.target, value, lowest_mu, highest_mu) # the two from surface.reachable(force)

- The footprint is the finger's way during one sample of the drive's envelope. The field leaves out
  what is shorter than two footprints, which the envelope would turn into other, longer waves.
- `target` says what the value is: an absolute friction coefficient ("mu"), a change from the
  friction without voltage as a part of it ("contrast"), or a share of the reachable range
  ("share").
- Values may be out of reach, noise below 0 or above 1: what becomes of those is the renderer's
  choice. `headroom` draws and counts them beforehand.
- Places that are NaN, infinite or absurdly far give `outside` and never raise. Fields hold no
  state.
- One number for the footprint is the fast way: an array of them costs several times as much.

`Texture` is a photograph or a height map, `Grating` and `Noise` are computed, `Recording` is a
profile from a file, `PennModel` reads textures of the Penn Haptic Texture Toolkit, and
`Composition` puts `Sprite`s of any of these on the screen.
"""

from haptix.texture.composition import Composition, Sprite
from haptix.texture.field import FrictionField, Target, as_mu
from haptix.texture.grating import Grating
from haptix.texture.headroom import Headroom, headroom
from haptix.texture.heights import HeightRule
from haptix.texture.noise import Noise, power_law
from haptix.texture.penn import PennModel
from haptix.texture.recorded import Recording
from haptix.texture.sidecar import Sidecar
from haptix.texture.texture import Texture

__all__ = [
    "Composition",
    "FrictionField",
    "Grating",
    "Headroom",
    "HeightRule",
    "Noise",
    "PennModel",
    "Recording",
    "Sidecar",
    "Sprite",
    "Target",
    "Texture",
    "as_mu",
    "headroom",
    "power_law",
]
