"""What makes a pair's calibration believable to the eye, and what mending it changes, without touching a pixel.

For pages and notebooks: near and far points against the offset assumed, the rows over the picture, and a drive's
results with the pair mended (to first order; `stereocalib run --self-calibrate` looks at the pictures again).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.back.rig.relative_yaw_kernels import MOTION, TURN, pair_equations
from stereocalib_core.back.rig.stereo_tracks import StereoTracks
from stereocalib_core.back.rig.yaw_solution import YawSolution
from stereocalib_core.config import PairConfig
from stereocalib_core.geometry import DisparityPlane, Extrinsics, StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.chunks import in_chunks
from stereocalib_core.results import FrameResult, Pair, PairCorrection


@dataclass(frozen=True)
class NearAndFar:
    """How far the car drove by near and by far points alone, over the disparity offset assumed.

    offset_px: (K,). near, far: (K,) length of the path over that by all points at the offset found. The two cross
    where the offset is right: with a wrong one near and far points want different motions. split_m: depth between
    near and far.
    """

    offset_px: Array
    near: Array
    far: Array
    split_m: float


def near_and_far(
    tracks: StereoTracks,
    solution: YawSolution,
    roll_pitch: tuple[float, float],
    offsets_px: Array,
    config: PairConfig,
) -> NearAndFar:
    """The evidence for an offset: one linear step from the solution for near and for far points alone."""
    camera, used = tracks.camera, solution.used
    disparity = tracks.rays[2] + solution.yaw_rad
    split = float(np.median(disparity)) if len(disparity) else 1.0
    turns = np.asarray(offsets_px) / camera.focal_px - solution.yaw_rad
    lengths = np.linalg.norm(solution.motions[used, 3:], axis=1)
    ahead = solution.motions[used, 3:] / np.maximum(lengths, 1e-9)[:, None]
    paths = []
    for part in (disparity >= split, disparity < split):
        normal, right = _equations(tracks, solution, roll_pitch, part, config)
        H, g = normal[used], right[used]
        H[:, range(MOTION), range(MOTION)] += 1e-6 * np.abs(H[:, range(MOTION), range(MOTION)]).max()
        steps = np.linalg.solve(
            H[:, :MOTION, :MOTION], np.dstack([H[:, :MOTION, MOTION : MOTION + 1], g[:, :MOTION, None]])
        )
        by_yaw, own = (np.einsum("nk,nk->n", steps[:, 3:, k], ahead) for k in (0, 1))
        whole = np.linalg.cond(H[:, :MOTION, :MOTION]) < config.worst_condition
        total = lengths[whole].sum()
        paths.append((total + own[whole].sum() - by_yaw[whole].sum() * turns) / max(total, 1e-9))
    depth = camera.baseline_m / split if split > 0 else float("inf")
    return NearAndFar(np.asarray(offsets_px), paths[0], paths[1], depth)


def _equations(
    tracks: StereoTracks,
    solution: YawSolution,
    roll_pitch: tuple[float, float],
    part: NDArray[np.bool_],
    config: PairConfig,
) -> tuple[Array, Array]:
    """Normal equations (N, 9, 9) and (N, 9) of some of the points at the solution."""
    count = len(tracks)
    active = np.zeros(count, dtype=bool)
    active[solution.used] = True
    before = np.concatenate([[0], np.cumsum(part)])
    normal, right = np.zeros((count, MOTION + TURN, MOTION + TURN)), np.zeros((count, MOTION + TURN))
    in_chunks(
        pair_equations, count,
        np.ascontiguousarray(tracks.rays[:, part]), before[tracks.start], active, solution.motions,
        np.array([solution.yaw_rad, *roll_pitch]), solution.noise_px / tracks.camera.focal_px, config.tuning,
        normal, right, np.zeros(int(before[-1])),
    )  # fmt: skip
    return normal, right


def rows_over_picture(camera: StereoCamera, pair: Pair, columns: int = 24, rows: int = 8) -> Array:
    """(rows, columns) right row minus left row [px] over the picture, as the pair's rows were measured."""
    u = (np.arange(columns) + 0.5) * camera.width / columns - 0.5
    v = (np.arange(rows) + 0.5) * camera.height / rows - 0.5
    cx = camera.cx_px if camera.cx_right_px is None else camera.cx_right_px
    x = ((u - cx) / camera.focal_px)[None, :]
    y = ((v - camera.cy_px) / camera.focal_px)[:, None]
    offset = 0.0 if pair.row_offset_px is None else pair.row_offset_px.value
    roll = 0.0 if pair.relative_roll_rad is None else pair.relative_roll_rad.value
    keystone = pair.keystone_rad if np.isfinite(pair.keystone_rad) else 0.0
    return np.asarray(offset * (1.0 + y * y) + camera.focal_px * (roll * x + keystone * x * y))


def results_mended(
    camera: StereoCamera, results: Sequence[FrameResult], correction: PairCorrection
) -> list[FrameResult]:
    """The front end's results as they would be with the pair mended, to first order: disparities of tracks, and the
    road's plane, which a yaw lifts as a whole and a roll tilts (eq. 16). The scale of depths is the camera's."""
    return [_mended(camera, result, correction) for result in results]


def _mended(camera: StereoCamera, result: FrameResult, c: PairCorrection) -> FrameResult:
    road, tracks, lidar = result.road, result.tracks, result.lidar
    if road is not None:
        plane = road.extrinsics.disparity_plane(camera)
        lifted = DisparityPlane(plane.a - c.roll_rad, plane.b, plane.c_px + camera.focal_px * c.yaw_rad)
        extrinsics = lifted.extrinsics(camera, road.extrinsics.yaw_rad)
        if lidar is not None:
            moved = _three(extrinsics) - _three(road.extrinsics)
            lidar = dataclasses.replace(lidar, values=lidar.values - moved)
        road = dataclasses.replace(road, extrinsics=extrinsics)
    if tracks is not None and len(tracks):
        points = tracks.points.astype(np.float64)
        lean = np.zeros((len(points), 2)) if tracks.lean is None else tracks.lean.astype(np.float64)
        for k, first in enumerate((0, 3)):
            points[:, first + 2] += _missing(camera, points[:, first : first + 3], lean[:, k], c)
        tracks = dataclasses.replace(tracks, points=points.astype(np.float32))
    return dataclasses.replace(result, road=road, tracks=tracks, lidar=lidar)


def _three(e: Extrinsics) -> Array:
    """(3,) height [m], pitch, roll [rad]."""
    return np.array([e.height_m, e.pitch_rad, e.roll_rad])


def _missing(camera: StereoCamera, seen: Array, lean: Array, c: PairCorrection) -> Array:
    """(N,) [px] what the turn of the right camera took from the disparities of (N, 3) u, v, disparity, which the
    match leans by (N,) `Tracks.lean`."""
    f = camera.focal_px
    x = (seen[:, 0] - camera.cx_px - seen[:, 2]) / f
    y = (seen[:, 1] - camera.cy_px) / f
    down = c.yaw_rad * x * y + c.roll_rad * x
    return np.asarray(f * (c.yaw_rad * (1.0 + x * x) - c.roll_rad * y - c.pitch_rad * x * y + lean * down))
