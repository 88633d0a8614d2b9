"""Textures: the friction that each place on the screen should have.

Every texture is a `FrictionField`. The renderer asks it for one block of the finger's path at a
time::

    footprint_mm = speed_mm_per_s / envelope_rate_hz      # of the fastest finger
    value = field.friction(x_mm, y_mm, footprint_mm)       # float64, of the shape of x_mm and y_mm
    mu = as_mu(field.target, value, lowest_mu, highest_mu) # the two from surface.reachable(force)

- The footprint is the distance that the finger slides during one sample of the drive's envelope.
  The field leaves out waves shorter than two footprints; the envelope would turn them into other,
  longer waves.
- `target` says what the value is: a friction coefficient ("mu"), the relative change from the
  friction without voltage ("contrast"), or a share of the reachable range ("share").
- A value may be out of reach, for example noise below 0 or above 1. The renderer decides what
  becomes of it; `headroom` draws and counts such values beforehand.
- Places that are NaN, infinite or beyond any screen give `outside` and never raise.
- A field has no state.
- One footprint for the whole block is fast; an array of them takes several times as long.

`Texture` is a photograph or a height map. `Grating` and `Noise` are computed. `RecordedProfile` is
a profile from a file. `PennModel` reads textures of the Penn Haptic Texture Toolkit.
`haptix.Layout` puts any of these on the screen.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
