"""Processes that decode, draw and compute for one owner."""
