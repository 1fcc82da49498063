"""From where on a result is called so: the lines between good and bad, same and different, sure and unsure."""

from __future__ import annotations

MIN_OK_FRACTION = 0.5
"""With fewer frames ok than this share, what a drive says must not be trusted."""
SIGNIFICANT_SIGMAS = 3.0
"""Two drives differ from so many sigmas of the difference on: one in 370 by chance."""
SAME_TIME_S = 1e-3
"""Frames of two runs are the same within this: times are written in milliseconds."""
SURE = 2.0
"""Sigmas from which something is mended."""
REFERENCE_M = 30.0
"""The depth at which a bend's effect is told: two seconds ahead at 50 km/h."""
