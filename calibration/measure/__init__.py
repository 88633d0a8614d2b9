"""The strokes: sources of force, recordings, their checks and reduction."""
