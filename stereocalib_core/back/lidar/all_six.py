"""What a drive says of yaw, x and z of its LiDAR, beside the road's height, pitch and roll: the end of `slips`.

Not every drive shows them. An open road has no edges, and a wall alone no yaw apart from x: what is more uncertain
than is useful is not given, and why is said.

Who has moved? A camera that is knocked takes its own path along: within one frame it turns or shifts by as much as
the LiDAR does not. Where the path shows that jump it was the camera; where it would and does not, the LiDAR.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from stereocalib_core.back.lidar.alignment import Alignment, Scan, distinct, scans_of, sweep_belief
from stereocalib_core.back.lidar.residual_transform import AXES, IS_ANGLE, YAW, X, Z, moved
from stereocalib_core.back.lidar.slips import Follower, Slip, find_slips, stretches
from stereocalib_core.config import LidarAlignmentConfig
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import SIGMA_PER_MAD
from stereocalib_core.results import (
    FrameResult,
    LidarCheck,
    LidarPose,
    LidarShift,
    LidarStretches,
    Measured,
    Residual,
)

OWN: dict[int, Literal["yaw", "x", "z"]] = {YAW: "yaw", X: "x", Z: "z"}
"""The axes that only edges and surfaces show."""
NO_ROAD = (
    "no frame shows scan and stereo road together: height, pitch and roll are by edges and surfaces alone"
)
SOME_UNSEEN = "a road fixes roll, pitch and height of the LiDAR; its depth edges do not show its {}"


def with_all_six(
    by_road: LidarCheck | None,
    results: Sequence[FrameResult],
    camera: StereoCamera,
    poses: Array,
    config: LidarAlignmentConfig,
    offset_px: Measured | None = None,
) -> LidarCheck | None:
    """The road's check with yaw, x and z; None where there is neither a road nor a scan.

    poses: (N, 4, 4) T_world_camera of all frames. offset_px: to be added to measured disparities, as the motion of the
    car shows it.
    """
    scans = scans_of(results, camera, poses, config)
    if by_road is None and not scans:
        return None
    check = by_road or LidarCheck(None, None, None, (), 0, NO_ROAD)
    if len(scans) < config.least_scans:
        return replace(check, why=f"{len(scans)} scans, needs {config.least_scans}")
    belief = sweep_belief(scans, camera, config)
    if offset_px is not None:
        belief = belief.with_offset(offset_px, config)
    follower = Follower(scans, camera, config, belief)
    whole = follower.whole(0, len(scans))
    clear = distinct(scans, camera, config, belief, whole)
    reason = _refusal(whole, clear, len(scans), config)
    if reason is not None:
        return replace(check, why=reason)
    slips = find_slips(follower)
    parts = stretches(follower, slips)
    last = max((slip.at for slip in slips), default=0)
    end = follower.whole(last, len(scans))
    measured = _measured(end, config)
    residuals = _residuals(follower, parts, measured)
    unmeasured = [axis for axis in OWN if not measured[axis]]
    unseen = [] if by_road is not None else [NO_ROAD]
    why = None
    if unmeasured:
        worst = ", ".join(f"{AXES[axis]} +-{_told(end.sigma[axis], axis)}" for axis in unmeasured)
        unseen.append(SOME_UNSEEN.format(" and ".join(AXES[axis] for axis in unmeasured)))
        why = f"{end.matched:.0f} edges of {end.things} things leave {worst}"
    shifts = [_shift(scans, poses, results, slip, config) for slip in slips if slip.axis in OWN]
    start = follower.whole(0, min((slip.at for slip in slips), default=len(scans)))
    shifts += _offsets(start, config)
    return replace(
        check,
        shifts=tuple(sorted((*check.shifts, *shifts), key=lambda s: (s.frame, AXES.index(s.axis)))),
        unseen="; ".join(unseen),
        yaw_rad=residuals.get(YAW),
        x_m=residuals.get(X),
        z_m=residuals.get(Z),
        why=why,
        stretches=LidarStretches(
            np.array([part.first for part in parts], dtype=np.int64),
            np.array([part.last for part in parts], dtype=np.int64),
            np.array([part.six for part in parts]),
            np.array([part.sigma for part in parts]),
        ),
        pose=_pose(scans[-1], end, measured),
    )


def _refusal(whole: Alignment, clear: float, count: int, config: LidarAlignmentConfig) -> str | None:
    """Why edges say nothing at all, or None."""
    if whole.things < config.least_things:
        return (
            f"too little structure: {whole.matched:.0f} depth edges of {whole.things} things in {count} scans, "
            f"needs {config.least_things} things"
        )
    if clear < config.least_distinct:
        return (
            f"edges of scan and picture do not belong together: no yaw brings them together better than others "
            f"({clear:.2f} times as well, needs {config.least_distinct:g})"
        )
    return None


def _measured(end: Alignment, config: LidarAlignmentConfig) -> Array:
    """(6,) whether each is known well enough to be given."""
    most = np.where(IS_ANGLE, np.deg2rad(config.most_sigma_deg), config.most_sigma_m)
    return np.asarray(end.sigma < most)


def _told(value: float, axis: int) -> str:
    return f"{np.rad2deg(value):.2f} deg" if IS_ANGLE[axis] else f"{100 * value:.1f} cm"


def _residuals(follower: Follower, parts: Sequence[Alignment], measured: Array) -> dict[int, Residual]:
    """Median and scatter over the stretches; where there is but one, over its odd and its even scans."""
    if len(parts) == 1:
        parts = follower.halves()
    values, sigma = np.array([part.six for part in parts]), np.array([part.sigma for part in parts])
    found = {}
    for axis in OWN:
        if measured[axis]:
            median = float(np.median(values[:, axis]))
            away = values[:, axis] - median
            found[axis] = Residual(
                median,
                float(SIGMA_PER_MAD * np.median(np.abs(away))),
                float(np.sqrt(np.mean(away**2))),
                float(np.median(sigma[:, axis])),
            )
    return found


def _pose(scan: Scan, end: Alignment, measured: Array) -> LidarPose:
    six = np.where(measured, end.six, 0.0)
    unknown = np.where(measured, 0.0, np.nan)
    return LidarPose(
        scan.T_camera_lidar,
        moved(scan.T_camera_lidar, six),
        six + unknown,
        end.sigma + unknown,
        end.first,
        end.last,
    )


def _offsets(start: Alignment, config: LidarAlignmentConfig) -> list[LidarShift]:
    """The calibration is off from the start, by more than its tolerance."""
    limit = np.where(IS_ANGLE, np.deg2rad(config.limit_yaw_deg), config.limit_shift_m)
    return [
        LidarShift(start.first, name, float(start.six[axis]), float(start.sigma[axis]), "offset", start.last)
        for axis, name in OWN.items()
        if abs(start.six[axis]) - config.certain_sigmas * start.sigma[axis] > limit[axis]
    ]


def _shift(
    scans: Sequence[Scan],
    poses: Array,
    results: Sequence[FrameResult],
    slip: Slip,
    config: LidarAlignmentConfig,
) -> LidarShift:
    frame, seen = scans[slip.at].frame, scans[slip.seen_by].frame
    row = next(row for row, result in enumerate(results) if result.frame == frame)
    who = who_jumped(poses, row, slip.axis, slip.size, config)
    return LidarShift(frame, OWN[slip.axis], slip.size, slip.sigma, "step", seen, who)


def who_jumped(
    poses: Array, row: int, axis: int, size: float, config: LidarAlignmentConfig
) -> Literal["lidar", "camera"] | None:
    """Which of the two moved by `size` along `axis` at frame `row`, by the camera's own path; None = it does not tell.

    poses: (N, 4, 4) T_world_camera. A camera's jump stands out from its steps before and after; it has the other sign.
    """
    near = config.told_frames
    first, last = max(row - 4 * near, 1), min(row + 4 * near, len(poses))
    before, after = poses[first - 1 : last - 1], poses[first:last]
    turn = np.swapaxes(before[:, :3, :3], 1, 2) @ after[:, :3, :3]
    way = np.einsum("nji,nj->ni", before[:, :3, :3], after[:, :3, 3] - before[:, :3, 3])
    steps = {YAW: -np.arctan2(turn[:, 0, 2], turn[:, 0, 0]), X: way[:, 0], Z: way[:, 2]}[axis]
    at = row - first
    if not (near <= at < len(steps) - near) or not np.isfinite(steps).all():
        return None
    # against the line through its neighbours: a car brakes and turns smoothly
    jumps = steps[1:-1] - 0.5 * (steps[:-2] + steps[2:])
    close = np.abs(np.arange(1, len(steps) - 1) - at) <= near // 2
    noise = SIGMA_PER_MAD * float(np.median(np.abs(jumps[~close])))
    jump = float(jumps[close][np.argmax(np.abs(jumps[close]))])
    if abs(jump + size) < config.borne_out * abs(size):
        return "camera"
    quiet = noise < config.quiet_share * abs(size)
    return "lidar" if quiet and abs(jump) < config.borne_out * abs(size) else None
