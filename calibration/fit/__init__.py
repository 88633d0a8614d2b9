"""From strokes to parameters with intervals."""
