"""All tracks of a drive in one block, so that motion and trajectory are arithmetic on a few arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.geometry import StereoCamera
from stereocalib_core.odometry.camera_motion import solve_stereo
from stereocalib_core.odometry.road_planes import fit_planes
from stereocalib_core.results import FrameResult, Tracks

Array = NDArray[np.float64]

STILL_FLOW_PX = 0.06
"""Median flow below which a pair stands still; 5 mm of travel move a road point 10 m ahead by as much."""

PLANE_CAUCHY_PX = 0.3
"""Disparity residual at which a road point's weight in `measured_planes` is one half."""

MIN_POINTS = 10
"""Fewer tracks than this give no motion."""


@dataclass(frozen=True)
class PackedTracks:
    """The tracks of N frames, M points; row i of every per-frame array is the pair (previous[i], i).

    rays: (5, M) x, y, inverse depth [1/m] by the measured disparity (NaN = unknown) in the previous pair and
        x, y in this one; x = (u - cx) / f, y = (v - cy) / f.
    current_inverse_depth: (M,) measured in this pair [1/m], NaN = unknown.
    start: (N + 1,) the points of pair i are start[i] ... start[i + 1], those on the road first.
    road_end: (N,) where the road points of pair i end.
    previous: (N,) the other frame of the pair, -1 = no tracks.
    road_ok: (N,) whether the frame showed its road.
    """

    camera: StereoCamera
    rays: Array
    current_inverse_depth: Array
    start: NDArray[np.int64]
    road_end: NDArray[np.int64]
    previous: NDArray[np.int64]
    road_ok: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.previous)

    @cached_property
    def still(self) -> NDArray[np.bool_]:
        """(N,) pairs in which the picture does not move: the median flow is below `STILL_FLOW_PX`."""
        flow = (self.rays[3:5] - self.rays[:2]) * self.camera.focal_px
        result = np.zeros(len(self), dtype=bool)
        for i in np.flatnonzero(np.diff(self.start) >= MIN_POINTS):
            pair = flow[:, self.start[i] : self.start[i + 1]]
            result[i] = bool(np.all(np.abs(np.median(pair, axis=1)) < STILL_FLOW_PX)) and bool(
                np.median(np.hypot(pair[0], pair[1])) < 4 * STILL_FLOW_PX
            )
        return result

    @cached_property
    def stereo_motion(self) -> Array:
        """(N, 7) rotation vector [rad], translation [m] of T_current_previous (left camera) from measured
        disparities alone, and 1 where it could be solved; the start of every other solution."""
        return solve_stereo(
            self.rays, self.start, self.previous, self.still, self.camera.focal_px, MIN_POINTS
        )

    @cached_property
    def measured_planes(self) -> Array:
        """(N, 4) the road as the tracks' own disparities show it: normal / height [1/m] in the camera
        frame of
        each frame, and the number of points behind it (0 = not enough)."""
        following = np.full(len(self), -1, dtype=np.int64)
        following[self.previous[self.previous >= 0]] = np.flatnonzero(self.previous >= 0)
        scale = PLANE_CAUCHY_PX / (self.camera.focal_px * self.camera.baseline_m)
        return fit_planes(self.rays, self.current_inverse_depth, self.start, self.road_end, following, scale)


def pack(camera: StereoCamera, results: Sequence[FrameResult]) -> PackedTracks:
    """Front-end results, one per frame in order, to one block."""
    return pack_tracks(
        camera,
        [r.tracks for r in results],
        np.array([r.ok for r in results], dtype=bool),
        [r.frame for r in results],
    )


def pack_tracks(
    camera: StereoCamera,
    tracks: Sequence[Tracks | None],
    road_ok: NDArray[np.bool_] | None = None,
    frames: Sequence[int] | None = None,
) -> PackedTracks:
    """Tracks of consecutive frames to one block; `frames` are the indices that `Tracks.previous`
    speaks of.
    """
    count = len(tracks)
    row_of = {frame: row for row, frame in enumerate(range(count) if frames is None else frames)}
    blocks: list[NDArray[np.float32]] = []
    start = np.zeros(count + 1, dtype=np.int64)
    road_end = np.zeros(count, dtype=np.int64)
    previous = np.full(count, -1, dtype=np.int64)
    for i, pair in enumerate(tracks):
        start[i + 1] = road_end[i] = start[i]
        if pair is None or len(pair) == 0 or row_of.get(pair.previous, count) >= i:
            continue
        off_road = ~pair.on_road & np.isfinite(pair.points[:, 2])
        blocks += [pair.points[pair.on_road], pair.points[off_road]]
        road_end[i] += np.count_nonzero(pair.on_road)
        start[i + 1] = road_end[i] + np.count_nonzero(off_road)
        previous[i] = row_of[pair.previous]
    points = np.concatenate([*blocks, np.zeros((0, 6), np.float32)]).astype(np.float64).T
    f, fb = camera.focal_px, camera.focal_px * camera.baseline_m
    rays = np.stack(
        [
            (points[0] - camera.cx_px) / f,
            (points[1] - camera.cy_px) / f,
            points[2] / fb,
            (points[3] - camera.cx_px) / f,
            (points[4] - camera.cy_px) / f,
        ]
    )
    ok = np.ones(count, dtype=bool) if road_ok is None else np.asarray(road_ok, dtype=bool)
    return PackedTracks(camera, np.ascontiguousarray(rays), points[5] / fb, start, road_end, previous, ok)
