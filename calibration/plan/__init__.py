"""Before the strokes: parameters, predicted strokes, the protocol."""
