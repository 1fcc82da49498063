"""Settings of the pair's own calibration: relative yaw by the car's motion, depth scale by LiDAR or a known path."""

from __future__ import annotations

from pydantic.dataclasses import dataclass

from stereocalib_core.config.steps import PairStepConfig
from stereocalib_core.config.strict import STRICT


@dataclass(frozen=True, config=STRICT)
class PairConfig:
    """The pair's relative yaw by the motion of the car."""

    noise_px: float = 0.1
    """First guess of the noise of a point in one picture; the drive's own residuals then say."""
    tuning: float = 9.0
    """Misfit over noise^2 at which a point counts a quarter: three times what is usual (Geman-McClure)."""
    min_points: int = 12
    """Fewer points hold no motion of six degrees."""
    min_pairs: int = 8
    """Fewer moving pairs of frames make no groups to take a sigma from."""
    pairs_together: int = 10
    """So many neighbouring pairs share their scene and count as one: at 10 frames a second, a second of driving."""
    rounds: int = 12
    settled_rad: float = 2e-8
    """A hundred-thousandth of a pixel at any focal length in use."""
    most_rescaled: float = 3.0
    """The noise is taken larger or smaller by this factor at most in one round, while motions still settle."""
    least_shown: float = 1e-4
    """Of the yaw's part in the disparities, what no motion explains; less is a scene at one depth."""
    strips: int = 5
    """Upright strips of the picture with equally many points, for sigma."""
    worst_condition: float = 1e12
    """Of a pair's motion when a strip is left out."""
    strip_share: float = 0.5
    """Of the jackknife over strips. Set on a few drives, then confirmed on 10 rendered ones (seeds 101 to 112)."""
    patches_strips_px: float = 0.008
    """What the jackknife over strips says in a rendered drive, where no lens is wrong [px]: patches are matched a
    little differently in the middle and beside it, ever alike, and the yaw does not follow. Maximum likelihood with
    the three below on 48 rendered drives of 200 frames and pieces of them (seeds 2000 to 2023 and 3000 to 3023)."""
    scenes_last: float = 2.1
    """1 sigma by noise, in units of what pairs of frames without anything in common would have: points stay in view for
    many pairs, and what a scene does to them for longer than a group of pairs shows."""
    share_of_yaw: float = 0.0022
    """1 sigma as a share of the yaw: a turned picture moves rows too (x y yaw), and a search along rows takes that for
    disparity (x^2 yaw) where lines run towards the vanishing point. The lean that tracks keep takes most of it, to
    first order."""
    least_sigma_px: float = 0.001
    """1 sigma of the disparity offset that no drive removes [px]. Not more than this by those 48; that a drive of an
    hour knows it any better is not shown."""
    unlike_turn: float = 0.5
    """A turn by the yaw shows in the rows as a keystone of the same size. One that is off by more than this share, and
    by `unlike_sigmas` of its own scatter besides, says that the offset of disparities is not, or not only, that of a
    turn: a principal point shifts them alike all over the picture, a lens in its own way. Physics: half way to no turn
    at all."""
    unlike_sigmas: float = 4.0
    share_of_roll: float = 0.06
    """The same of the relative roll (rows x roll). Tuned on one rendered drive with 0.1 deg."""
    min_scans: int = 4
    """Fewer LiDAR scans make no sigma."""
    least_samples: int = 40
    """Of a scan; fewer is a scan without surfaces."""
    jitter_deg: float = 0.05
    """1 sigma of LiDAR against camera from scan to scan: a body that pitches by 5 deg/s, 10 ms apart."""
    pose_angle_deg: float = 0.05
    pose_m: float = 0.02
    """1 sigma of how LiDAR and camera are placed: a careful calibration by targets, by judgement. Looked at with the
    scans of raw 0009 and 0005, so what those say of the scale is no independent check."""
    sweep_sigma: float = 2.0
    """1 sigma of the share of a scan's time that moves its points: +1 or -1 by the sense of rotation, 0 where they
    were put right."""
    lidar_range_m: float = 0.02
    """1 sigma of a LiDAR's range. Source: data sheet of the HDL-64E."""
    lidar_angle_deg: float = 0.02
    """1 sigma of where a point of it is seen: a fifth of its beam's divergence (0.11 deg). Physics."""
    match_px: float = 0.12
    """1 sigma of the disparity of a patch on a surface that is a plane only nearly. Physics: some hundredths by noise,
    a tenth by the surface."""
    first_noise: float = 1.5
    """What all of these are multiplied with, until the residuals say."""
    least_noise: float = 0.1
    lidar_tuning: float = 3.0
    """Residual in sigmas at which a sample counts a quarter."""
    lidar_rounds: int = 10
    half_rounds: int = 5
    """... of a half of the scans, which starts where all of them ended."""
    lidar_samples: int = 40_000
    """Samples of a drive that are put together, every scan evenly thinned: with more, how LiDAR and camera are placed
    is all that is unsure."""
    most_scale_sigma: float = 0.03
    """A scale less sure than this is none."""
    least_step_m: float = 0.3
    """Of the car between two frames, for its length to be compared with a truth's: ten times a step's noise."""
    strays: float = 4.0
    """Steps further from the median ratio, in sigmas, are a jump of the GNSS."""
    path_systematic: float = 0.001
    """1 sigma of a path's scale that no length removes, by the tracks' own bias on rendered drives."""
    unknown_scale: float = 0.01
    """1 sigma of a scale of depth that nobody measured: of KITTI's rig of 2011_09_26 by its LiDAR, over ten times what
    its targets claim. Calibrated together, an offset and a scale undo each other where the targets stood."""
    scale_range_m: float = 15.0
    """... and about where a path takes its length from: on a street most near points are 10 to 20 m away."""
    suspect_yaw_deg: float = 0.02
    bad_yaw_deg: float = 0.08
    steps: PairStepConfig = PairStepConfig()


@dataclass(frozen=True, config=STRICT)
class ScanDisparityConfig:
    """Disparities by LiDAR beside those by the pair."""

    nearest_m: float = 3.0
    """Nearer, LiDAR and camera see things from too different places."""
    farthest_m: float = 80.0
    """Farther, a cell holds too few points."""
    cell_px: int = 10
    """Half a patch of the matcher; holds two beams of a 64-beam LiDAR."""
    least_points: int = 5
    flat_px: float = 0.3
    """A LiDAR's 2 cm are less than that beyond 6 m; an edge is more."""
    correlation: float = 0.75
    reach_px: float = 2.0
    """Of the fine match about the dense one."""
    most_px: float = 6.0
    """Difference of the two; 0.4 deg of relative yaw at 700 px. More is another thing than the LiDAR saw."""
    most_tried: int = 1200
    """Surfaces of a scan that are matched: nearly all that a LiDAR of 64 beams shows, at 1 us of CPU each."""
    most_samples: int = 700
    """Kept of each scan."""
    every: int = 3
    """So many scans pass before the next is compared, once the drive has shown `all_until` of them: a surface stays in
    view for longer, and what it says the first time it says again."""
    all_until: int = 30

    def wanted(self, frame: int) -> bool:
        """Whether this frame's scan is compared."""
        return frame < self.all_until or frame % self.every == 0
