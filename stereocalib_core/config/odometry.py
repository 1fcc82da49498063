"""Settings of the back end's motion: how the tracks of a drive become its path."""

from __future__ import annotations

from pydantic.dataclasses import dataclass

from stereocalib_core.config.strict import STRICT, Floor, Share


@dataclass(frozen=True, config=STRICT)
class SolverConfig:
    """Gauss-Newton with Cauchy weights on the reprojection error of one pair of frames."""

    noise_px: float = 0.4
    """Typical residual of a track [px]. Tuned on KITTI 03 and 06."""
    cauchy_px: float = 1.0
    """Residual at which a point's weight is one half [px]: some 2.5 times the noise, where Cauchy's loss keeps 95 %
    of the efficiency of least squares (Holland and Welsch 1977)."""
    iterations: int = 12
    """At most; four or five reach rest. Numerical."""
    wide_px: tuple[float, ...] = (30.0, 5.0)
    """Cauchy scales [px] that come before `cauchy_px` where nothing is known of the motion yet: the first takes in
    the flow of a pair that starts at rest."""


@dataclass(frozen=True, config=STRICT)
class OdometryConfig:
    """Motion of the camera from the tracks, in every model."""

    solver: SolverConfig = SolverConfig()
    min_points: int = 10
    """Fewer tracks give no motion: six unknowns and some to spare for the weights. Numerical."""
    min_road_points: int = 12
    """Fewer road points do not carry the scale of a pair. Numerical."""
    min_points_of_a_kind: int = 8
    """Points on and above the road from which the common depth factor of the latter is estimated. Numerical."""
    still_m: float = 0.006
    """A pair that moves less and turns less stands still [m]: a tenth of walking pace at 10 Hz, and about three
    standard deviations of what tracks of a standing car show."""
    still_rad: float = 5e-4
    scale_sigma: float = 0.003
    """How far the depths of points off the road may differ from those of the road, as a factor, 1 sigma. Tuned on
    KITTI 03 and 06: the depth scale of a calibrated pair differs by some 0.3 % between near and far."""
    disparity_noise_px: float = 0.25
    """1 sigma of the disparity of a tracked point [px], against which eq. 16 is weighed. Source: matches of textured
    patches on KITTI against its LiDAR; calibration errors of a quarter pixel are common."""
    road_height_floor_m: Floor = 0.006
    """How far the road under one point differs from the plane of the extrinsics, 1 sigma, as the height [m], pitch and
    roll [deg] that it would be. Physics: roads of ISO 8608 class A to B are off a plane by 4 to 8 mm over some tens
    of metres, and a bend of 1 in 1500 lifts or sinks the road 10 m beyond the lane by as much as 0.06 deg of pitch. The
    best path hardly depends on them: from a quarter of these values to four times as much its final error is 0.52 to
    0.56 % on KITTI 06, 0.23 to 0.26 % on 03, t_rel 0.12 to 0.21 % on the synthetic town of seed 5. What they set is how
    much a wrong road bends the path: pitch and roll tripled end 8 times as far off on 06, 3 with double floors."""
    road_pitch_floor_deg: Floor = 0.06
    road_roll_floor_deg: Floor = 0.1
    min_measured: Share = 0.5
    """A path of which a smaller share was measured on the road has no errors: it is a gap."""
    lever_min_travel_m: float = 0.1
    """Pairs that move less say nothing of the direction of travel [m]. Physics: sigma of a motion is some 3 mm."""
    lever_min_pairs: int = 10
    """Fewer moving pairs give no lever arm. Numerical."""
    lever_yaw_floor_deg: Floor = 0.005
    """1 sigma of the yaw that no number of pairs takes away [deg]: the unevenness of road and tyres."""
    lever_floor_m: Floor = 0.02
    """The same of the lever arm [m]."""
    turn_rad: float = 0.02
    """A pair that turns by more shows the lever arm [rad]: L times this is well over the noise of a motion."""
    turn_pairs: int = 8
    """So many such pairs are needed; a regression over fewer reads the lever arm from the noise of headings."""
