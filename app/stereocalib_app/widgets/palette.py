"""Colours that carry meaning, chosen to stay apart for colour-blind readers (after Okabe and Ito).

The trajectories keep the hues of the paper; they also differ in dash and weight, so hue is never alone.
"""

from __future__ import annotations

from typing import Final

Rgb = tuple[int, int, int]

INK: Final[Rgb] = (232, 234, 237)
INK_SOFT: Final[Rgb] = (164, 170, 178)
PAPER: Final[Rgb] = (24, 27, 31)
RULE: Final[Rgb] = (74, 80, 88)

FREE: Final[Rgb] = (86, 180, 233)
ROAD: Final[Rgb] = (0, 158, 115)
OBSTACLE: Final[Rgb] = (230, 120, 0)
HORIZON: Final[Rgb] = (240, 228, 66)
GRID: Final[Rgb] = (245, 245, 245)
LIVE: Final[Rgb] = (98, 120, 255)
FAILED: Final[Rgb] = (213, 94, 0)
COMPARED: Final[Rgb] = (204, 121, 167)
NOW: Final[Rgb] = (240, 160, 0)

RAW: Final[Rgb] = (86, 150, 220)
FILTERED: Final[Rgb] = (0, 158, 115)
TRUTH: Final[Rgb] = (205, 60, 60)
SMOOTHED: Final[Rgb] = (230, 159, 0)

BRAND: Final[Rgb] = (0, 92, 148)

VARIANT: Final[dict[str, Rgb]] = {
    "ground_truth": (222, 45, 38),
    "autocalibrated": (0, 158, 70),
    "no_yaw": (0, 190, 230),
    "no_roll": (240, 150, 0),
    "no_pitch_no_roll": (215, 60, 200),
    "live": LIVE,
}
VARIANT_NAME: Final[dict[str, str]] = {
    "ground_truth": "ground truth",
    "autocalibrated": "autocalibrated",
    "no_yaw": "no yaw",
    "no_roll": "no roll",
    "no_pitch_no_roll": "no pitch, no roll",
    "live": "live settings",
}


def css(rgb: Rgb, alpha: float = 1.0) -> str:
    """An RGB colour as CSS."""
    return f"rgba({rgb[0]},{rgb[1]},{rgb[2]},{alpha:g})"
