"""Logs of trials: thresholds, scales, power, and studies in BIDS."""
