"""Signals: quantities against time, described by plain tables and evaluated by sample number."""
