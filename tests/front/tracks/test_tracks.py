"""Tracks on rendered roads of known motion, and on real recordings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from stereocalib_core.back.evaluation import evaluate
from stereocalib_core.back.odometry.packing import pack
from stereocalib_core.back.odometry.trajectory import Trajectory, TrajectorySettings, trajectory
from stereocalib_core.config import DisparityConfig, PipelineConfig
from stereocalib_core.frames import FrameSource, StereoFrame
from stereocalib_core.front.matching import compute
from stereocalib_core.front.pipeline import FrontEnd
from stereocalib_core.front.tracks.pair_motion import reprojection
from stereocalib_core.front.tracks.tracks import PairView, TrackerState, advance, patch_affine
from stereocalib_core.geometry import Extrinsics, StereoCamera, invert_transform, planar_motion
from stereocalib_core.numeric.small_algebra import vector_from_rotation
from stereocalib_core.results import Tracks
from stereocalib_core.simulator.plane import render_plane
from stereocalib_core.sources import open_source

CAMERA = StereoCamera(800, 300, 460.0, 400.0, 140.0, 0.54)
MOUNTS = (Extrinsics.from_degrees(1.65, 0.8, -0.4), Extrinsics.from_degrees(1.66, 1.0, -0.2))


def view(
    index: int, extrinsics: Extrinsics, x: float, z: float, heading: float, noise: float = 1.5
) -> PairView:
    left, right = render_plane(
        CAMERA, extrinsics, noise=noise, clutter=True, position_xz_m=(x, z), heading_rad=heading
    )
    return PairView(index, left, right, compute(left, right, CAMERA, DisparityConfig()), extrinsics)


def true_motion(x: float, z: float, heading: float) -> NDArray[np.float64]:
    """T_current_previous of the camera between the two mounts."""
    T_road = planar_motion(x, z, heading)
    return MOUNTS[1].T_camera_road @ invert_transform(T_road) @ invert_transform(MOUNTS[0].T_camera_road)


def errors(tracks: Tracks, T: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 3) where a track ended less where it should have, u, v, disparity [px]."""
    points = tracks.points.astype(np.float64)
    seen = CAMERA.back_project(*points[:, :3].T) @ T[:3, :3].T + T[:3, 3]
    return points[:, 3:] - CAMERA.project(seen)


@pytest.fixture(scope="module")
def pair() -> tuple[PairView, PairView]:
    return view(0, MOUNTS[0], 0.0, 0.0, 0.0), view(1, MOUNTS[1], 0.02, 0.8, np.deg2rad(1.0))


def test_tracks_agree_with_the_known_motion(pair: tuple[PairView, PairView]) -> None:
    state, nothing = advance(CAMERA, TrackerState(), pair[0])
    assert nothing is None
    _, tracks = advance(CAMERA, state, pair[1])
    assert tracks is not None and tracks.previous == 0
    assert tracks.on_road.sum() > 60 and (~tracks.on_road).sum() > 15
    e = errors(tracks, true_motion(0.02, 0.8, np.deg2rad(1.0)))
    road = e[tracks.on_road]
    assert np.abs(np.median(road, axis=0)).max() < 0.03
    assert np.median(np.abs(road[:, :2])) < 0.1
    assert np.mean(np.hypot(e[:, 0], e[:, 1]) < 1.0) > 0.95
    planes = [m.disparity_plane(CAMERA) for m in MOUNTS]
    for plane, columns in zip(planes, (slice(0, 3), slice(3, 6)), strict=True):
        u, v, disparity = tracks.points[tracks.on_road, columns].astype(np.float64).T
        assert np.median(np.abs(disparity - plane.disparity(CAMERA, u, v))) < 0.06


@pytest.mark.parametrize(("z", "heading_deg"), [(0.0, 0.0), (0.3, -2.0), (1.4, 0.5), (2.2, 0.0)])
def test_the_motion_is_found_without_any_prediction(z: float, heading_deg: float) -> None:
    heading = np.deg2rad(heading_deg)
    state, _ = advance(CAMERA, TrackerState(), view(0, MOUNTS[0], 0.0, 0.0, 0.0))
    state, tracks = advance(CAMERA, state, view(1, MOUNTS[1], 0.0, z, heading))
    assert tracks is not None and len(tracks) > 40
    assert np.median(np.abs(errors(tracks, true_motion(0.0, z, heading))[:, :2])) < 0.15
    assert state.motion is not None


def test_a_wrong_prediction_is_recovered_from(pair: tuple[PairView, PairView]) -> None:
    """The car was thought to stop; it goes on, because frames were lost."""
    state, _ = advance(CAMERA, TrackerState(), pair[0])
    wrong = TrackerState(state.view, state.pyramid, state.corners, np.array([0, 0.02, 0, 0, 0, -3.0]))
    _, expected = advance(CAMERA, state, pair[1])
    _, tracks = advance(CAMERA, wrong, pair[1])
    assert expected is not None and tracks is not None
    assert len(tracks) > 0.8 * len(expected)
    assert np.median(np.abs(errors(tracks, true_motion(0.02, 0.8, np.deg2rad(1.0)))[:, :2])) < 0.15


def test_what_moves_by_itself_does_not_survive(pair: tuple[PairView, PairView]) -> None:
    """A poster glued to the camera, as another car at the same speed would be: no point of it may be kept."""
    rng = np.random.default_rng(0)
    poster = rng.integers(0, 255, (12, 16)).repeat(8, axis=0).repeat(8, axis=1).astype(np.uint8)
    views = []
    for v in pair:
        left, right = v.left.copy(), v.right.copy()
        left[100:196, 330:458] = poster
        right[100:196, 310:438] = poster
        views.append(
            PairView(v.index, left, right, compute(left, right, CAMERA, DisparityConfig()), v.extrinsics)
        )
    state, _ = advance(CAMERA, TrackerState(), views[0])
    assert state.corners is not None
    u, v = state.corners.points.T
    assert np.count_nonzero((u > 330) & (u < 458) & (v > 100) & (v < 196)) > 3
    _, tracks = advance(CAMERA, state, views[1])
    assert tracks is not None and len(tracks) > 40
    u, v = tracks.points[:, :2].T
    assert np.count_nonzero((u > 338) & (u < 450) & (v > 108) & (v < 188)) == 0


def test_without_a_known_road_only_points_above_it_are_tracked(pair: tuple[PairView, PairView]) -> None:
    lost = [PairView(v.index, v.left, v.right, v.disparity, Extrinsics(1.65, 0, 0), False) for v in pair]
    state, _ = advance(CAMERA, TrackerState(), lost[0])
    _, tracks = advance(CAMERA, state, lost[1])
    assert tracks is not None and len(tracks) > 15 and not tracks.on_road.any()


def test_patches_are_sheared_as_the_road_is() -> None:
    """Against differences of road pixels carried from one picture to the next."""
    T = true_motion(0.1, 0.9, 0.02)
    plane, step = MOUNTS[0].disparity_plane(CAMERA), 1e-3

    def carried(u: float, v: float) -> NDArray[np.float64]:
        point = CAMERA.back_project(u, v, plane.disparity(CAMERA, u, v))
        return np.asarray(CAMERA.project(T[:3, :3] @ point + T[:3, 3])[:2])

    u, v = 480.0, 220.0
    columns = [
        (carried(u + step * du, v + step * dv) - carried(u - step * du, v - step * dv)) / (2 * step)
        for du, dv in ((1, 0), (0, 1))
    ]
    f = CAMERA.focal_px
    inverse_depth = plane.disparity(CAMERA, u, v) / (f * CAMERA.baseline_m)
    rays = np.array(
        [[(u - CAMERA.cx_px) / f], [(v - CAMERA.cy_px) / f], [float(inverse_depth)], [0.0], [0.0]]
    )
    motion = np.concatenate([vector_from_rotation(T[:3, :3]), T[:3, 3]])
    affine = patch_affine(rays, motion, reprojection(rays, motion), np.array([True]), MOUNTS[0])
    np.testing.assert_allclose(affine.reshape(2, 2), np.array(columns).T, atol=1e-5)


def test_blank_pictures_give_no_tracks() -> None:
    blank = np.full((300, 800), 90, dtype=np.uint8)
    views = [
        PairView(i, blank, blank, compute(blank, blank, CAMERA, DisparityConfig()), MOUNTS[0])
        for i in range(2)
    ]
    state, _ = advance(CAMERA, TrackerState(), views[0])
    state, tracks = advance(CAMERA, state, views[1])
    assert tracks is None and state.motion is None


def test_state_and_pictures_are_left_alone_and_results_repeat(pair: tuple[PairView, PairView]) -> None:
    before = pair[0].left.copy()
    runs = []
    for _ in range(2):
        state, _ = advance(CAMERA, TrackerState(), pair[0])
        runs.append(advance(CAMERA, state, pair[1])[1])
    assert runs[0] is not None and runs[1] is not None
    assert np.array_equal(runs[0].points, runs[1].points)
    assert np.array_equal(pair[0].left, before)


def drive(source: FrameSource, frames: list[int]) -> Trajectory:
    """Odometry over chosen frames of a recording, with this pair's own extrinsics."""
    end = FrontEnd(source.camera, PipelineConfig())
    results = []
    for new, old in enumerate(frames):
        frame = source[old]
        results.append(end.step(StereoFrame(new, 0.1 * new, frame.left, frame.right, frame.failure)))
    rows = [
        [r.road.extrinsics.height_m, r.road.extrinsics.pitch_rad, r.road.extrinsics.roll_rad, 0.0]
        if r.road
        else [np.nan] * 4
        for r in results
    ]
    return trajectory(pack(source.camera, results), np.array(rows), TrajectorySettings())


@pytest.mark.parametrize(("name", "limit_percent"), [("06", 1.06), ("03", 1.13)])
def test_real_drives_end_where_they_should(data_dir: Path, name: str, limit_percent: float) -> None:
    """Below what the usual C++ stereo odometry reaches on the same frames."""
    source = open_source(str(data_dir / "kitti_odometry" / "sequences" / name))
    truth = source.ground_truth
    assert truth is not None
    errors = evaluate(drive(source, list(range(len(source)))).poses, truth.poses)
    assert errors.final_translation_percent is not None
    assert errors.final_translation_percent < limit_percent


def test_a_real_raw_drive_has_the_right_length(kitti_raw_0009: Path) -> None:
    source = open_source(str(kitti_raw_0009))
    truth = source.ground_truth
    assert truth is not None
    frames = [i for i in range(len(source)) if source[i].left is not None and source[i].right is not None]
    errors = evaluate(drive(source, frames).poses, truth.poses)
    assert errors.path_gt_m is not None
    assert abs(errors.path_m / errors.path_gt_m - 1.0) < 0.005


def test_a_real_drive_with_a_stop_and_lost_frames(kitti_06: Path) -> None:
    """Frame 12 is seen six times (the car stands), frames 21 and 22 never."""
    source = open_source(str(kitti_06))
    truth = source.ground_truth
    assert truth is not None and truth.poses is not None
    frames = [*range(10), *[12] * 6, *range(13, 21), *range(23, 32)]
    poses = drive(source, frames).poses
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    assert steps[10:15].max() <= 0.002
    true = np.linalg.norm(np.diff(truth.poses[frames][:, :3, 3], axis=0), axis=1)
    assert np.abs(steps - true).max() < 0.1
