"""The studio: its pages share one browser."""
