"""Whether the fit holds: verification strokes, budget, steadiness."""
