"""All six between LiDAR and camera: drives past boxes with known answers, then real ones."""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path

import numpy as np
import pytest
from simulated_edges import CALIBRATED, CAMERA, drive

from stereocalib_core.back.lidar.alignment import Belief, align, scans_of, sweep_belief
from stereocalib_core.back.lidar.all_six import who_jumped, with_all_six
from stereocalib_core.back.lidar.overlay import before_and_after
from stereocalib_core.back.lidar.residual_transform import YAW, X, Z, moved, shown_by_road
from stereocalib_core.back.lidar.road_check import check
from stereocalib_core.config import LidarAlignmentConfig, RoadCheckConfig
from stereocalib_core.geometry import Extrinsics, invert_transform, rotation_y
from stereocalib_core.results import FrameResult, LidarCheck, Measured

CONFIG = LidarAlignmentConfig()
DEGREE = float(np.rad2deg(1.0))
SIX = np.array([0.02, *np.deg2rad([0.3, -0.4, 1.0]), -0.08, 0.1])
STILL = Belief.of(CONFIG, 0.0, CONFIG.known_sweep_sigma)


def found(results: list[FrameResult], poses: np.ndarray) -> LidarCheck:
    road = check(results, RoadCheckConfig())
    assert road is not None
    return with_all_six(road, results, CAMERA, poses, CONFIG)


# ---- the six and what a road shows of them ---------------------------------------------------------------------


def test_a_road_shows_the_six_as_the_lane_fit_would() -> None:
    road = Extrinsics(1.65, 0.05, -0.03)
    small = np.array([0.01, 0.002, -0.003, 0.004, 0.02, -0.03])
    # the road in the true LiDAR's frame, carried back by the calibration
    plane = road.plane().transformed(invert_transform(moved(CALIBRATED, small))).transformed(CALIBRATED)
    seen = Extrinsics.from_plane(plane)
    expected = [
        seen.height_m - road.height_m,
        seen.pitch_rad - road.pitch_rad,
        seen.roll_rad - road.roll_rad,
    ]
    shown = shown_by_road(road.plane().normal, CALIBRATED) @ small
    np.testing.assert_allclose(shown, expected, atol=5e-5)


# ---- one stretch -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_lidar_far_off_is_found_from_nowhere(sign: float) -> None:
    results, poses = drive(30, {0: sign * SIX})
    scans = scans_of(results, CAMERA, poses, CONFIG)
    one = align(scans, CAMERA, CONFIG, STILL)
    error = one.six - sign * SIX
    assert np.all(np.abs(error) < [0.005, *np.deg2rad([0.02, 0.03, 0.02]), 0.007, 0.007]), error
    assert np.all(one.sigma < [0.01, *np.deg2rad([0.05, 0.05, 0.04]), 0.012, 0.012])


def test_sigma_is_what_other_drives_differ_by() -> None:
    misses = []
    bare = dataclasses.replace(CONFIG, systematic_px=1e-3)
    for seed in range(16):
        results, poses = drive(12, {0: 0.2 * SIX}, seed=seed)
        one = align(scans_of(results, CAMERA, poses, bare), CAMERA, bare, STILL)
        misses.append((one.six - 0.2 * SIX) / one.sigma)
    spread = np.sqrt(np.mean(np.square(misses), axis=0))
    # five road residuals count as one and here each is one: what the road holds is known better than it says
    assert np.all(spread < 2.0) and np.all(spread[[YAW, X, Z]] > 0.3) and np.all(spread > 0.2), spread


def test_a_sweep_is_undone_by_the_cars_own_motion() -> None:
    results, poses = drive(30, sweep=-1.0, stated_sweep=-1.0)
    scans = scans_of(results, CAMERA, poses, CONFIG)
    told = align(scans, CAMERA, CONFIG, sweep_belief(scans, CAMERA, CONFIG))
    assert np.all(np.abs(told.six[[YAW, X, Z]]) < [np.deg2rad(0.02), 0.007, 0.007])
    ignored = align(scans, CAMERA, CONFIG, STILL)
    assert np.any(np.abs(ignored.six[[YAW, X, Z]]) > [np.deg2rad(0.1), 0.03, 0.03])


@pytest.mark.parametrize("sweep", [-1.0, 0.0, 1.0])
def test_a_sweep_that_nobody_told_is_found(sweep: float) -> None:
    results, poses = drive(40, sweep=sweep, stated_sweep=None)
    belief = sweep_belief(scans_of(results, CAMERA, poses, CONFIG), CAMERA, CONFIG)
    assert belief.mean[7] == pytest.approx(sweep, abs=0.1) and belief.sigma[7] < 0.3


def test_a_sense_of_rotation_that_is_stated_wrongly_is_found_out() -> None:
    results, poses = drive(40, sweep=-1.0, stated_sweep=1.0)
    belief = sweep_belief(scans_of(results, CAMERA, poses, CONFIG), CAMERA, CONFIG)
    assert belief.mean[7] == pytest.approx(-1.0, abs=0.1)
    taken_at_its_word, poses = drive(12, sweep=0.0, stated_sweep=0.0)
    belief = sweep_belief(scans_of(taken_at_its_word, CAMERA, poses, CONFIG), CAMERA, CONFIG)
    assert belief.mean[7] == 0.0 and belief.sigma[7] == CONFIG.known_sweep_sigma


def test_a_car_that_stands_leaves_the_sweep_open() -> None:
    results, poses = drive(12, stated_sweep=None)
    still = [dataclasses.replace(results[0], frame=k, timestamp_s=0.1 * k) for k in range(12)]
    belief = sweep_belief(scans_of(still, CAMERA, poses * 0 + np.eye(4), CONFIG), CAMERA, CONFIG)
    assert belief.sigma[7] > 0.7


# ---- a drive ---------------------------------------------------------------------------------------------------


def test_a_clean_drive_has_no_slip_and_no_residual() -> None:
    clean = found(*drive(90))
    assert clean.shifts == () and clean.why is None and clean.unseen == ""
    assert abs(clean.yaw_rad.median) < np.deg2rad(0.02)
    assert abs(clean.x_m.median) < 0.007 and abs(clean.z_m.median) < 0.007
    assert len(clean.stretches.first) == 3 and clean.stretches.first[1] == 30
    assert np.all(np.abs(clean.pose.T_camera_lidar - CALIBRATED) < 0.01)


@pytest.mark.parametrize(
    ("axis", "size"), [("yaw", np.deg2rad(0.3)), ("x", 0.05), ("z", -0.05), ("yaw", np.deg2rad(-1.0))]
)
def test_a_slip_is_dated_sized_and_named(axis: str, size: float) -> None:
    six = np.zeros(6)
    six[{"yaw": YAW, "x": X, "z": Z}[axis]] = size
    results, poses = drive(80, {43: six})
    after = found(results, poses)
    (slip,) = after.shifts
    assert (slip.axis, slip.kind, slip.moved) == (axis, "step", "lidar")
    assert abs(slip.frame - 43) <= 3 and slip.detected_at <= 43 + 40
    assert slip.size == pytest.approx(size, rel=0.25) and abs(slip.size - size) < 4 * slip.sigma
    # the mended calibration is that after the slip
    np.testing.assert_allclose(after.pose.T_camera_lidar, moved(CALIBRATED, six), atol=0.012)
    assert after.pose.first >= slip.frame


def test_a_lidar_knocked_far_is_found_again() -> None:
    six = np.array([0.0, 0.0, 0.0, np.deg2rad(-1.8), 0.1, 0.0])
    shifts = found(*drive(80, {40: six})).shifts
    assert [(shift.axis, shift.frame) for shift in shifts] == [("yaw", 40), ("x", 40)]
    np.testing.assert_allclose([shift.size for shift in shifts], six[[YAW, X]], rtol=0.1)


def test_a_slip_of_the_roads_axes_is_not_put_down_to_others() -> None:
    six = np.array([0.0, 0.0, np.deg2rad(0.6), 0.0, 0.0, 0.0])
    shifts = found(*drive(80, {40: six})).shifts
    assert [shift.axis for shift in shifts] == ["roll"]


def test_a_calibration_that_is_off_from_the_start_raises_the_alarm() -> None:
    six = np.zeros(6)
    six[[YAW, Z]] = np.deg2rad(0.6), -0.15
    shifts = found(*drive(40, {0: six})).shifts
    assert [(shift.axis, shift.kind) for shift in shifts] == [("yaw", "offset"), ("z", "offset")]
    np.testing.assert_allclose([shift.size for shift in shifts], six[[YAW, Z]], atol=0.01)


def test_scans_of_another_moment_are_refused() -> None:
    refused = found(*drive(40, swap=13))
    assert refused.yaw_rad is None and refused.x_m is None and refused.pose is None
    assert "do not belong together" in refused.why


def test_an_open_road_is_refused_and_says_why() -> None:
    refused = found(*drive(40, every_m=45.0))
    assert refused.yaw_rad is None and "too little structure" in refused.why
    few = found(*drive(6))
    assert few.yaw_rad is None and few.why == "6 scans, needs 10"


def test_edges_say_what_they_can_where_no_frame_shows_a_road() -> None:
    six = np.zeros(6)
    six[[YAW, X]] = np.deg2rad(0.4), 0.1
    results, poses = drive(40, {0: six})
    without = [dataclasses.replace(result, road=None, lidar=None) for result in results]
    assert check(without, RoadCheckConfig()) is None
    alone = with_all_six(None, without, CAMERA, poses, CONFIG)
    assert alone is not None and alone.height_m is None and alone.roll_rad is None and alone.frames == 0
    assert abs(alone.yaw_rad.median - six[YAW]) < np.deg2rad(0.05)
    assert alone.x_m.median == pytest.approx(0.1, abs=0.03)
    assert "by edges and surfaces alone" in alone.unseen
    bare = [dataclasses.replace(result, scan=None) for result in without]
    assert with_all_six(None, bare, CAMERA, poses, CONFIG) is None


def test_an_offset_that_the_cars_motion_shows_is_believed() -> None:
    told = Belief.of(CONFIG).with_offset(Measured(0.3, 0.02), CONFIG)
    assert told.mean[8] == -0.3 and told.sigma[8] == pytest.approx(np.hypot(0.02, CONFIG.matcher_bias_px))
    results, poses = drive(20)
    shifted = [
        dataclasses.replace(r, scan=dataclasses.replace(r.scan, packed_patches=_less(r.scan.packed_patches)))
        for r in results
    ]
    scans = scans_of(shifted, CAMERA, poses, CONFIG)
    for scan in scans:
        assert len(scan.patches)
    free, knowing = (align(scans, CAMERA, CONFIG, belief) for belief in (Belief.of(CONFIG), told))
    assert knowing.nuisance_sigma[2] < free.nuisance_sigma[2] and knowing.sigma[Z] <= free.sigma[Z]
    assert abs(knowing.nuisance[2] + 0.3) < 0.15


def _less(packed: np.ndarray) -> np.ndarray:
    """Patches (P, 5) whose disparity is 0.25 px too small."""
    return packed - np.array([0, 0, 16, 0, 0], np.int16)


def test_the_same_drive_gives_the_same_bits() -> None:
    one, other = (found(*drive(50)) for _ in range(2))
    assert one.pose.six.tobytes() == other.pose.six.tobytes()
    assert one.stretches.values.tobytes() == other.stretches.values.tobytes()


def test_who_has_moved_is_told_by_the_cameras_path() -> None:
    poses = np.tile(np.eye(4), (60, 1, 1))
    rng = np.random.default_rng(0)
    poses[:, 2, 3] = np.arange(60.0)
    poses[:, :3, 3] += 0.003 * rng.standard_normal((60, 3))
    assert who_jumped(poses, 30, X, 0.05, CONFIG) == "lidar"
    jumped = poses.copy()
    jumped[31:, 0, 3] -= 0.05
    assert who_jumped(jumped, 30, X, 0.05, CONFIG) == "camera"
    rough = poses.copy()
    rough[:, :3, 3] += 0.03 * rng.standard_normal((60, 3))
    assert who_jumped(rough, 30, X, 0.05, CONFIG) is None
    assert who_jumped(poses, 2, X, 0.05, CONFIG) is None
    # a camera that comes to look left by 0.3 deg: its heading jumps to the left, the LiDAR then looks right of it
    left = poses.copy()
    left[31:, :3, :3] = rotation_y(-np.deg2rad(0.3))
    assert who_jumped(left, 30, YAW, -np.deg2rad(0.3), CONFIG) == "camera"
    assert who_jumped(left, 30, YAW, np.deg2rad(0.3), CONFIG) is None
    assert who_jumped(poses, 30, YAW, np.deg2rad(0.3), CONFIG) == "lidar"


def test_the_overlay_of_what_was_found_lies_on_the_pictures_edges() -> None:
    results, poses = drive(30, {0: SIX})
    after = found(results, poses)
    misses = []
    for edges in before_and_after(results[5].scan, after.pose, CAMERA):
        beside = [
            np.abs(results[5].scan.picture_edges[:, 0] - u)[
                (np.abs(results[5].scan.picture_edges[:, 1] - v) < 3)
                & (results[5].scan.picture_edges[:, 3] == side)
            ].min(initial=99.0)
            for u, v, side in edges
        ]
        misses.append(float(np.median(beside)))
    assert misses[1] < 1.5 and misses[0] > 3.0


# ---- real drives -----------------------------------------------------------------------------------------------


@functools.cache
def looked_at(folder: Path, count: int):  # type: ignore[no-untyped-def]
    """Results, camera and path of the frames with scans."""
    from stereocalib_core.back.analyse import analyse
    from stereocalib_core.config import PipelineConfig
    from stereocalib_core.front.pipeline import FrontEnd
    from stereocalib_core.sources import open_source

    source = open_source(str(folder))
    front_end = FrontEnd(source.camera, PipelineConfig(), T_camera_lidar=source.T_camera_lidar)
    results = [front_end.step(source[i]) for i in range(count)]
    return results, source.camera, analyse(results, source.camera, PipelineConfig()).poses


@pytest.fixture
def both(kitti_raw_0009: Path, kitti_raw_0005: Path):  # type: ignore[no-untyped-def]
    """Two drives of one rig on one day."""
    return {"0009": looked_at(kitti_raw_0009, 12), "0005": looked_at(kitti_raw_0005, 18)}


@pytest.fixture(params=["0009", "0005"])
def real(request: pytest.FixtureRequest, both):  # type: ignore[no-untyped-def]
    """One of them."""
    return both[request.param]


def real_scans(real, off: np.ndarray | None = None):  # type: ignore[no-untyped-def]
    """The scans with a calibration that is turned and moved."""
    results, camera, poses = real
    six = np.zeros(6) if off is None else off
    scans = []
    for scan in scans_of(results, camera, poses, CONFIG):
        road = scan.road
        if road is not None:
            road = (road[0] - road[2] @ six, *road[1:])
        scans.append(dataclasses.replace(scan, T_camera_lidar=moved(scan.T_camera_lidar, six), road=road))
    return scans


def test_kittis_own_calibration_is_confirmed(real) -> None:  # type: ignore[no-untyped-def]
    results, camera, poses = real
    road = check(results, RoadCheckConfig())
    confirmed = with_all_six(road, results, camera, poses, CONFIG)
    assert confirmed.shifts == () and confirmed.why is None
    assert abs(confirmed.yaw_rad.median) < np.deg2rad(0.2)
    assert abs(confirmed.x_m.median) < 0.08 and abs(confirmed.z_m.median) < 0.08


def test_odd_and_even_scans_agree_as_sigma_says(real) -> None:  # type: ignore[no-untyped-def]
    camera, scans = real[1], real_scans(real)
    belief = sweep_belief(scans, camera, CONFIG)
    odd, even = (align(scans[k::2], camera, CONFIG, belief) for k in (1, 0))
    assert np.all(np.abs(odd.six - even.six) < 2.0 * np.hypot(odd.sigma, even.sigma))
    # the road's three, of which edges along rows show little
    assert np.all(np.abs(odd.six - even.six)[:3] < [0.015, *np.deg2rad([0.1, 0.15])])


def test_a_street_and_a_crossing_find_the_same_rig(both) -> None:  # type: ignore[no-untyped-def]
    found = []
    for drive_ in both.values():
        scans = real_scans(drive_)
        found.append(align(scans, drive_[1], CONFIG, sweep_belief(scans, drive_[1], CONFIG)))
    apart, sigma = found[0].six - found[1].six, np.hypot(found[0].sigma, found[1].sigma)
    assert np.all(np.abs(apart) < 2.0 * sigma), apart / sigma
    assert np.all(sigma < [0.015, *np.deg2rad([0.1, 0.1, 0.1]), 0.03, 0.03])


@pytest.mark.parametrize(("axis", "size"), [(YAW, np.deg2rad(1.0)), (X, 0.1), (Z, 0.1)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_real_lidar_moved_in_software_is_found(real, axis: int, size: float, sign: float) -> None:  # type: ignore[no-untyped-def]
    camera = real[1]
    scans = real_scans(real)
    belief = sweep_belief(scans, camera, CONFIG)
    as_it_is = align(scans, camera, CONFIG, belief).six
    off = np.zeros(6)
    off[axis] = sign * size
    again = align(real_scans(real, off), camera, CONFIG, belief).six
    assert abs(again[YAW] + off[YAW] - as_it_is[YAW]) < np.deg2rad(0.15)
    assert np.all(np.abs(again[[X, Z]] + off[[X, Z]] - as_it_is[[X, Z]]) < 0.05)


def test_real_scans_of_other_moments_are_refused(real) -> None:  # type: ignore[no-untyped-def]
    results, camera, poses = real
    mixed = [
        dataclasses.replace(
            result,
            scan=dataclasses.replace(
                result.scan,
                packed_beam_edges=results[(k + 7) % len(results)].scan.packed_beam_edges,
                packed_points=results[(k + 7) % len(results)].scan.packed_points,
            ),
        )
        for k, result in enumerate(results)
    ]
    refused = with_all_six(check(mixed, RoadCheckConfig()), mixed, camera, poses, CONFIG)
    assert refused.yaw_rad is None and refused.why


def test_odd_and_even_scans_see_the_same_pair_and_so_does_the_motion(real) -> None:  # type: ignore[no-untyped-def]
    from stereocalib_core.back.analyse import analyse
    from stereocalib_core.config import PipelineConfig

    pair = analyse(real[0], real[1], PipelineConfig()).pair
    offset_px, scale = np.abs(np.diff(np.array(pair.lidar_halves), axis=0)[0])
    assert offset_px <= 0.05 and scale <= 0.002
    assert f"differ by {offset_px:.3f} px" in pair.why
    motion, lidar = pair.disparity_offset_px, pair.by_lidar_px
    assert motion is not None and lidar is not None
    assert abs(motion.value - lidar.value) < 2.0 * np.hypot(motion.sigma, lidar.sigma)
