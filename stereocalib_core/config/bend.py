"""Settings of the search for a bend of the road ahead, up a ramp or down from a crest."""

from __future__ import annotations

from pydantic.dataclasses import dataclass

from stereocalib_core.config.strict import STRICT


@dataclass(frozen=True, config=STRICT)
class BendConfig:
    """What is surely the road's own surface where it leaves the plane found nearer by."""

    sharpest_per_m: float = 1.0 / 120.0
    """Curvature beyond which the car leaves its straight lane within it, and turns on [1/m]: no lane is known ahead.
    Physics: 1.7 m, half a lane, aside after 20 m."""
    bin_m: float = 1.0
    """Length of road that gives one height [m]: twice what a cell covers along at 20 m."""
    levels: int = 300
    level_m: float = 0.01
    """Heights over the plane are counted in so many steps of this [m], about zero. Numerical."""
    least_cells: int = 6
    """Fewer cells in half a bin are no surface. Numerical."""
    spread_m: float = 0.16
    """Between a fifth and four fifths of the cells of one bin [m]: more is no surface. Tuned on rendered ramps, cars
    and walls."""
    alike_m: float = 0.05
    alike_share: float = 0.1
    """Left and right may differ by this [m], and by this share of their height: half of a lane's crossfall."""
    on_plane_m: float = 0.08
    """A surface begins within this of the plane [m]: below a kerb."""
    steepest: float = 0.25
    """Rise per metre that is still a road. Source: the steepest public streets climb by 0.35, ramps by 0.15 to 0.2."""
    longest_gap: int = 3
    """Bins between two that are sure."""
    high_m: float = 0.2
    rising_m: float = 0.1
    rising_bins: int = 2
    """A rise ends above the first [m], higher than any kerb, with so many bins above the second [m]."""
    low_m: float = 0.07
    """Nothing but a road lies so far below the plane [m]: four times what the matcher errs by at 20 m; with
    `rising_bins` below half of it, as no crest goes down by a step."""
    kerb_m: float = 0.09
    """Higher than a hump in the road, lower than a kerb [m]."""
    hump_m: float = 0.025
    hump_bins: int = 2
    """So many neighbouring bins so far off the plane [m] are a hump or a dip: the matcher's own waves are half as
    high."""
