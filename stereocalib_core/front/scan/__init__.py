"""What a LiDAR scan of the same moment says of the road."""

from __future__ import annotations


def warm_up() -> None:
    """Compile what this package compiles."""
    from stereocalib_core.front.scan import lidar_road, scan_disparity, scan_sample

    lidar_road.warm_up()
    scan_sample.warm_up()
    scan_disparity.warm_up()
