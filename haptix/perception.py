"""What a finger can tell: constants of perception."""

from __future__ import annotations

WEBER_FRACTION = 0.11
"""Smallest relative change of friction that is felt (Gueorguiev et al. 2017; physics page, section
7, which also quotes 0.18 of Samur et al. 2009)."""
