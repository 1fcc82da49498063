"""All tracks of a drive in one block, so that motion and trajectory are arithmetic on a few arrays."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.back.odometry.camera_motion import solve_full, solve_stereo
from stereocalib_core.config import OdometryConfig
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.chunks import MOST_AT_ONCE, in_chunks
from stereocalib_core.numeric.spill import let_go, roomy
from stereocalib_core.results import FrameResult, Tracks


@dataclass(frozen=True)
class PackedTracks:
    """The tracks of N frames, M points; row i of every per-frame array is the pair (previous[i], i).

    rays: (5, M) x, y, inverse depth [1/m] by the measured disparity in the previous pair and x, y in this one;
        x = (u - cx) / f, y = (v - cy) / f.
    start: (N + 1,) the points of pair i are start[i] ... start[i + 1], those on the road first.
    road_end: (N,) where the road points of pair i end.
    previous: (N,) the other frame of the pair, -1 = no tracks.
    road_ok: (N,) whether the frame showed its road. config: how motions are solved.
    """

    camera: StereoCamera
    rays: Array
    start: NDArray[np.int64]
    road_end: NDArray[np.int64]
    previous: NDArray[np.int64]
    road_ok: NDArray[np.bool_]
    config: OdometryConfig = OdometryConfig()

    def __len__(self) -> int:
        return len(self.previous)

    def with_road(self, road_ok: NDArray[np.bool_]) -> PackedTracks:
        """The same tracks where other frames showed their road; what rests on the tracks alone is not solved again."""
        other = dataclasses.replace(self, road_ok=road_ok)
        for name in ("_stereo", "stereo_motion", "still", "active"):
            if name in self.__dict__:
                other.__dict__[name] = self.__dict__[name]
        return other

    @cached_property
    def stereo_motion(self) -> Array:
        """(N, 7) rotation vector [rad], translation [m] of T_current_previous (left camera) from measured
        disparities alone, and 1 where it could be solved; the start of every other solution."""
        return self._stereo[0]

    @property
    def stereo_covariance(self) -> Array:
        """(N, 6, 6) of `stereo_motion`."""
        return self._stereo[1]

    @cached_property
    def _stereo(self) -> tuple[Array, Array]:
        motions, covariances = np.zeros((len(self), 7)), roomy((len(self), 6, 6))
        in_chunks(
            solve_stereo, len(self),
            self.rays, self.start, self.previous, self.camera.focal_px, self.config.min_points,
            (*self.config.solver.wide_px, self.config.solver.cauchy_px), self.config.solver.iterations,
            motions, covariances,
        )  # fmt: skip
        return motions, covariances

    @cached_property
    def active(self) -> NDArray[np.bool_]:
        """(N,) pairs that move and have points enough."""
        return np.asarray(
            (self.previous >= 0) & ~self.still & (np.diff(self.start) >= self.config.min_points)
        )

    @property
    def solver(self) -> tuple[float, int, int]:
        """What `weighted_pair` is set by."""
        solver = self.config.solver
        return solver.noise_px, solver.iterations, self.config.min_points_of_a_kind

    def full_motion(
        self, road: NDArray[np.bool_], used: Array, given: Array, sigma: Array
    ) -> tuple[Array, Array]:
        """Every active pair by `solve_full`: (N, 7) motion and 1 where it was solved, (N, 6, 6) covariance.

        road: (N,) pairs whose road points are fused with the road. used, given: (N, 4) extrinsics as a variant has
        them, and as the drive does. sigma: (N, 3) of height, pitch, roll.
        """
        fb = self.camera.focal_px * self.camera.baseline_m
        motions, covariances = np.zeros((len(self), 7)), roomy((len(self), 6, 6))
        in_chunks(
            solve_full, len(self),
            self.rays, self.start, self.road_end, self.previous, road, used, given, sigma,
            (self.config.disparity_noise_px / fb) ** 2, self.active, self.stereo_motion, self.camera.focal_px,
            self.config.scale_sigma, self.config.solver.cauchy_px, self.solver, motions, covariances,
        )  # fmt: skip
        return motions, covariances

    @cached_property
    def still(self) -> NDArray[np.bool_]:
        """(N,) pairs between which the car stands, decided on measured disparities alone."""
        motion = self.stereo_motion
        turn, move = np.linalg.norm(motion[:, :3], axis=1), np.linalg.norm(motion[:, 3:6], axis=1)
        return np.asarray((motion[:, 6] > 0) & (turn < self.config.still_rad) & (move < self.config.still_m))


def pack(
    camera: StereoCamera, results: Sequence[FrameResult], config: OdometryConfig | None = None
) -> PackedTracks:
    """Front-end results, one per frame in order, to one block."""
    return pack_tracks(
        camera,
        [r.tracks for r in results],
        np.array([r.ok for r in results], dtype=bool),
        [r.frame for r in results],
        config,
    )


def pack_tracks(
    camera: StereoCamera,
    tracks: Sequence[Tracks | None],
    road_ok: NDArray[np.bool_] | None = None,
    frames: Sequence[int] | None = None,
    config: OdometryConfig | None = None,
) -> PackedTracks:
    """Tracks of consecutive frames to one block; `Tracks.previous` is one of `frames` (default 0, 1, ...)."""
    count = len(tracks)
    row_of = {frame: row for row, frame in enumerate(range(count) if frames is None else frames)}
    whole: dict[int, NDArray[np.bool_]] = {}
    start = np.zeros(count + 1, dtype=np.int64)
    road_end = np.zeros(count, dtype=np.int64)
    previous = np.full(count, -1, dtype=np.int64)
    for i, pair in enumerate(tracks):
        start[i + 1] = road_end[i] = start[i]
        if pair is None or len(pair) == 0 or row_of.get(pair.previous, count) >= i:
            continue
        whole[i] = np.isfinite(pair.points[:, :5]).all(axis=1) & (pair.points[:, 2] > 0)
        road_end[i] += np.count_nonzero(whole[i] & pair.on_road)
        start[i + 1] = road_end[i] + np.count_nonzero(whole[i] & ~pair.on_road)
        previous[i] = row_of[pair.previous]
        if i % MOST_AT_ONCE == 0:
            let_go(pair.points)
    f, fb = camera.focal_px, camera.focal_px * camera.baseline_m
    # pair by pair to its place: an hour's drive has tens of millions of points, and no room for a second copy
    rays = roomy((5, int(start[-1])))
    for i, kept in whole.items():
        pair = tracks[i]
        assert pair is not None
        for kind, first, last in (
            (pair.on_road, start[i], road_end[i]),
            (~pair.on_road, road_end[i], start[i + 1]),
        ):
            u, v, d, u_now, v_now = pair.points[kept & kind, :5].astype(np.float64).T
            rays[:, first:last] = (
                (u - camera.cx_px) / f,
                (v - camera.cy_px) / f,
                d / fb,
                (u_now - camera.cx_px) / f,
                (v_now - camera.cy_px) / f,
            )
        if i % MOST_AT_ONCE == 0:
            let_go(rays, pair.points)
    let_go(rays)
    ok = np.ones(count, dtype=bool) if road_ok is None else np.asarray(road_ok, dtype=bool)
    settings = config or OdometryConfig()
    return PackedTracks(camera, rays, start, road_end, previous, ok, settings)
