"""The back end on simulated tracks of a known drive."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from simulated_drive import CAMERA, camera_poses, car_path, mount_series, tracks_of

from stereocalib_core.back.evaluation import evaluate, heading_between, path_lengths
from stereocalib_core.back.odometry.lever_arm import estimate_lever_and_yaw
from stereocalib_core.back.odometry.packing import PackedTracks, pack_tracks
from stereocalib_core.back.odometry.road_depth import fused_rays, with_floors
from stereocalib_core.back.odometry.trajectory import VARIANTS, TrajectorySettings, apply_settings, trajectory
from stereocalib_core.errors import ConfigError
from stereocalib_core.geometry import Extrinsics, rotation_x, transform
from stereocalib_core.results import Tracks

FRAMES = 400
YAW, LEVER = np.deg2rad(-0.3), 0.95


class Drive:
    """A car's drive, its truth and its tracks."""

    def __init__(self, noise: float = 1.0, wobble: float = 1.0) -> None:
        rng = np.random.default_rng(1)
        self.extrinsics = mount_series(FRAMES, rng, wobble)
        self.planar = car_path(FRAMES, YAW, LEVER)
        self.poses = camera_poses(self.planar, self.extrinsics)
        self.tracks = tracks_of(self.poses, self.extrinsics, rng, 0.25 * noise, 0.1 * noise)
        self.packed: PackedTracks = pack_tracks(CAMERA, self.tracks)

    def percent(self, settings: TrajectorySettings, extrinsics: np.ndarray | None = None) -> float:
        given = self.extrinsics if extrinsics is None else extrinsics
        result = evaluate(trajectory(self.packed, given, settings).poses, self.poses)
        assert result.final_translation_percent is not None
        return result.final_translation_percent


@pytest.fixture(scope="module")
def drive() -> Drive:
    return Drive()


@pytest.fixture(scope="module")
def exact() -> Drive:
    return Drive(noise=0.0)


@pytest.mark.parametrize("model", ["full", "planar", "nonholonomic"])
def test_perfect_tracks_give_the_true_path(exact: Drive, model: str) -> None:
    result = trajectory(exact.packed, exact.extrinsics, TrajectorySettings(model=model, lever_arm_m=LEVER))  # type: ignore[arg-type]
    # float32 pixels and the arc model against a path made of the same arcs
    assert np.abs(result.poses[:, :3, 3] - exact.poses[:, :3, 3]).max() < 0.02
    assert np.abs(heading_between(result.poses[:, :3, :3], exact.poses[:, :3, :3])).max() < np.deg2rad(0.02)
    assert result.gaps == ()


@pytest.mark.parametrize("model", ["full", "planar", "nonholonomic"])
def test_noisy_tracks_stay_within_half_a_percent(drive: Drive, model: str) -> None:
    assert drive.percent(TrajectorySettings(model=model, lever_arm_m=LEVER)) < 0.5  # type: ignore[arg-type]


def test_full_model_follows_a_hill() -> None:
    """Over a crest the path leaves the first camera's plane; the full model sees it, a planar one cannot."""
    rng = np.random.default_rng(3)
    count = 80
    extrinsics = mount_series(count, rng, wobble=0.0)
    climb = transform(rotation_x(np.deg2rad(0.3)), [0.0, 0.0, 0.65])
    poses = np.array([np.linalg.matrix_power(climb, i) for i in range(count)])
    packed = pack_tracks(CAMERA, tracks_of(poses, extrinsics, rng))
    full = trajectory(packed, extrinsics, TrajectorySettings()).poses
    planar = trajectory(packed, extrinsics, TrajectorySettings("planar")).poses
    assert abs(poses[-1, 1, 3]) > 5.0
    assert np.linalg.norm(full[-1, :3, 3] - poses[-1, :3, 3]) < 0.3
    assert abs(planar[-1, 1, 3] - poses[-1, 1, 3]) > 3.0


def test_yaw_changes_nothing_in_the_free_models_and_everything_in_the_held_one(drive: Drive) -> None:
    for model in ("full", "planar"):
        a = trajectory(drive.packed, drive.extrinsics, TrajectorySettings(model=model))  # type: ignore[arg-type]
        b = trajectory(drive.packed, drive.extrinsics, TrajectorySettings(model=model, yaw_strength=0.0))  # type: ignore[arg-type]
        assert np.array_equal(a.poses, b.poses)
    held = TrajectorySettings("nonholonomic", lever_arm_m=LEVER)
    assert drive.percent(replace(held, yaw_strength=0.0)) > 3 * drive.percent(held)
    assert drive.percent(replace(held, lever_arm_m=0.0)) > drive.percent(held)


@pytest.mark.parametrize("model", ["full", "planar", "nonholonomic"])
def test_ablations_and_injected_errors_bend_the_path(drive: Drive, model: str) -> None:
    best = TrajectorySettings(model=model, lever_arm_m=LEVER)  # type: ignore[arg-type]
    good = drive.percent(best)
    ablated = replace(best, pitch_strength=0.0, roll_strength=0.0)
    assert drive.percent(ablated) > 3 * good
    for error in ("pitch_error_rad", "roll_error_rad"):
        bent = trajectory(drive.packed, drive.extrinsics, replace(best, **{error: np.deg2rad(1.0)}))
        straight = trajectory(drive.packed, drive.extrinsics, best)
        assert np.abs(bent.poses[:, :3, 3] - straight.poses[:, :3, 3]).max() > 1.0, error
    taller = trajectory(drive.packed, drive.extrinsics, replace(best, height_error_m=0.165))
    grown = taller.path_m / path_lengths(drive.poses)[-1]
    if model == "full":
        # the measured disparities have their say
        assert 1.02 < grown < 1.09
    else:
        assert grown == pytest.approx(1.1, rel=0.01)


def test_a_pitch_error_changes_the_scale_as_the_geometry_says(exact: Drive) -> None:
    """Road points at mean ray angle h / Z gain the factor 1 - dpitch Z / h in depth."""
    error = np.deg2rad(0.5)
    path = trajectory(
        exact.packed, exact.extrinsics, TrajectorySettings("planar", pitch_error_rad=error)
    ).path_m
    ratio = path / path_lengths(exact.poses)[-1]
    nearest, farthest = 1 - error * 6 / 1.65, 1 - error * 20 / 1.65
    assert farthest < ratio < nearest


@pytest.mark.parametrize("model", ["full", "planar", "nonholonomic"])
def test_extrinsics_tripled_ruin_the_path(drive: Drive, model: str) -> None:
    """The calibration drives the odometry: pitch and roll three times as large, and it ends elsewhere."""
    best = TrajectorySettings(model=model, lever_arm_m=LEVER)  # type: ignore[arg-type]
    tripled = drive.extrinsics * [1.0, 3.0, 3.0, 1.0]
    assert drive.percent(best, tripled) > 3 * drive.percent(best)


def test_stereo_alone_knows_no_extrinsics(drive: Drive) -> None:
    settings = TrajectorySettings("stereo_only")
    plain = trajectory(drive.packed, drive.extrinsics, settings)
    for other in (drive.extrinsics * 3.0, np.full_like(drive.extrinsics, np.nan)):
        assert np.array_equal(trajectory(drive.packed, other, settings).poses, plain.poses)
    assert plain.measured_share == 1.0
    assert evaluate(plain.poses, drive.poses).final_translation_percent < 0.5  # type: ignore[operator]


def test_weights_are_the_drives_and_not_the_variants(drive: Drive) -> None:
    """Depths are linear in what a variant does to 1 / h, which they would not be were the weights its own."""
    tracks, count = drive.packed, len(drive.packed)
    config = tracks.config
    variance = (config.disparity_noise_px / (CAMERA.focal_px * CAMERA.baseline_m)) ** 2

    def depths(factor: float) -> np.ndarray:
        used = drive.extrinsics / [factor, 1.0, 1.0, 1.0]
        on_road = tracks.previous >= 0
        sigma = with_floors(None, count, config)
        return fused_rays(
            tracks.rays, tracks.start, tracks.road_end, tracks.previous, on_road, used, drive.extrinsics,
            sigma, variance,
        )  # fmt: skip

    one, half, twice = depths(1.0), depths(0.5), depths(2.0)
    np.testing.assert_allclose(twice[2] - one[2], 2.0 * (one[2] - half[2]), atol=1e-12)
    np.testing.assert_array_equal(one[5], twice[5])


@pytest.mark.parametrize("sure_m", [1e-6, 10.0])
def test_a_road_point_is_where_the_surer_of_the_two_puts_it(drive: Drive, sure_m: float) -> None:
    """An exact road gives eq. 16, an unknown one the measured disparity."""
    tracks, count = drive.packed, len(drive.packed)
    variance = (0.25 / (CAMERA.focal_px * CAMERA.baseline_m)) ** 2
    fused = fused_rays(
        tracks.rays, tracks.start, tracks.road_end, tracks.previous, tracks.previous >= 0, drive.extrinsics,
        drive.extrinsics, np.full((count, 3), sure_m), variance,
    )  # fmt: skip
    i = 5
    points, previous = slice(tracks.start[i], tracks.road_end[i]), tracks.previous[i]
    expected = tracks.rays[2, points]
    if sure_m < 1.0:
        plane = Extrinsics(*drive.extrinsics[previous]).plane()
        x, y = tracks.rays[:2, points]
        expected = (plane.normal @ np.stack([x, y, np.ones_like(x)])) / plane.offset_m
    np.testing.assert_allclose(fused[2, points], expected, rtol=1e-3)


def test_no_road_anywhere_is_a_gap_without_figures(drive: Drive) -> None:
    packed = pack_tracks(CAMERA, drive.tracks, np.zeros(FRAMES, dtype=bool))
    for model in ("full", "planar", "nonholonomic"):
        result = trajectory(packed, drive.extrinsics, TrajectorySettings(model=model))  # type: ignore[arg-type]
        assert result.measured_share < 0.01
        errors = evaluate(result.poses, drive.poses, True, result.measured_share, 0.5)
        assert (
            errors.path_m is None
            and errors.final_translation_percent is None
            and errors.t_rel_percent is None
        )


def test_settings_act_as_their_fields_say() -> None:
    rows = np.array([[1.5, 0.01, 0.02, 0.03], [1.7, 0.03, -0.02, 0.03], [1.6, 0.02, 0.0, 0.03]])
    half = apply_settings(
        rows, TrajectorySettings(pitch_strength=0.5, height_strength=0.0, yaw_error_rad=0.01)
    )
    assert np.allclose(half[:, 0], 1.6)
    assert np.allclose(half[:, 1], [0.005, 0.015, 0.01])
    assert np.allclose(half[:, 2], rows[:, 2])
    assert np.allclose(half[:, 3], 0.04)
    with pytest.raises(ConfigError, match="strength"):
        TrajectorySettings(roll_strength=1.5)
    with pytest.raises(ConfigError, match="model"):
        TrajectorySettings(model="tank")  # type: ignore[arg-type]


@pytest.mark.parametrize("model", ["full", "planar"])
def test_yaw_and_lever_arm_come_from_the_drive_with_honest_sigmas(drive: Drive, model: str) -> None:
    free = trajectory(drive.packed, drive.extrinsics, TrajectorySettings(model=model))  # type: ignore[arg-type]
    found = estimate_lever_and_yaw(free)
    assert found is not None
    assert abs(found.yaw_rad - YAW) < min(3 * found.yaw_sigma_rad, np.deg2rad(0.05))
    assert abs(found.lever_arm_m - LEVER) < min(3 * found.lever_arm_sigma_m, 0.05)


def test_a_straight_drive_shows_yaw_but_no_lever_arm() -> None:
    rng = np.random.default_rng(5)
    extrinsics = mount_series(60, rng)
    poses = camera_poses(car_path(60, YAW, LEVER, straight=True), extrinsics)
    packed = pack_tracks(CAMERA, tracks_of(poses, extrinsics, rng))
    found = estimate_lever_and_yaw(trajectory(packed, extrinsics, TrajectorySettings("planar")))
    assert found is not None
    assert abs(found.yaw_rad - YAW) < 3 * found.yaw_sigma_rad
    assert found.lever_arm_sigma_m > 0.3
    still = trajectory(pack_tracks(CAMERA, [None] * 20), extrinsics[:20], TrajectorySettings("planar"))
    assert estimate_lever_and_yaw(still) is None


def test_covariances_fit_the_true_errors(drive: Drive) -> None:
    """Errors of single pairs in units of their sigma scatter about one, for heading and for distance."""
    for settings in (TrajectorySettings("planar"), TrajectorySettings()):
        free = trajectory(drive.packed, drive.extrinsics, settings)
        error = free.planar[1:] - drive.planar[1:]
        sigma = np.sqrt(np.diagonal(free.planar_covariance[1:], axis1=1, axis2=2))
        assert np.all(np.abs(np.std(error / sigma, axis=0) - 1.0) < 0.35)
    full = trajectory(drive.packed, drive.extrinsics, TrajectorySettings())
    moved = np.linalg.inv(full.poses[:-1]) @ full.poses[1:]
    truth = np.linalg.inv(drive.poses[:-1]) @ drive.poses[1:]
    heading = heading_between(truth[:, :3, :3], moved[:, :3, :3])
    assert abs(np.std(heading / np.sqrt(full.covariance[1:, 1, 1])) - 1.0) < 0.35


def standing(count: int, rng: np.random.Generator) -> tuple[np.ndarray, list[Tracks | None]]:
    extrinsics = mount_series(count, rng, wobble=0.0)
    return extrinsics, tracks_of(np.tile(np.eye(4), (count, 1, 1)), extrinsics, rng)


@pytest.mark.parametrize("model", ["full", "planar", "nonholonomic"])
def test_standing_still_is_no_motion(model: str) -> None:
    extrinsics, tracks = standing(30, np.random.default_rng(2))
    result = trajectory(pack_tracks(CAMERA, tracks), extrinsics, TrajectorySettings(model=model))  # type: ignore[arg-type]
    assert np.abs(result.poses - np.eye(4)).max() == 0.0
    assert result.gaps == ()


def test_creeping_is_not_taken_for_standing() -> None:
    rng = np.random.default_rng(4)
    extrinsics = mount_series(40, rng, wobble=0.0)
    motion = np.zeros((40, 3))
    motion[1:, 1] = 0.03
    poses = camera_poses(motion, extrinsics)
    result = trajectory(
        pack_tracks(CAMERA, tracks_of(poses, extrinsics, rng)), extrinsics, TrajectorySettings()
    )
    assert result.path_m == pytest.approx(1.17, rel=0.1)


@pytest.mark.parametrize("model", ["full", "planar", "nonholonomic"])
def test_lost_frames_and_failed_roads_are_gaps_without_a_jump(drive: Drive, model: str) -> None:
    extrinsics = drive.extrinsics.copy()
    tracks = list(drive.tracks)
    road_ok = np.ones(FRAMES, dtype=bool)
    road_ok[100:106] = False
    extrinsics[100:106] = np.nan
    for i in range(100, 107):
        pair = tracks[i]
        assert pair is not None
        tracks[i] = Tracks(pair.points[~pair.on_road], pair.on_road[~pair.on_road], pair.previous)
    tracks[200] = tracks[201] = None
    result = trajectory(
        pack_tracks(CAMERA, tracks, road_ok), extrinsics, TrajectorySettings(model=model, lever_arm_m=LEVER)
    )  # type: ignore[arg-type]
    assert result.gaps == ((100, 106), (200, 201))
    steps = np.linalg.norm(np.diff(result.poses[:, :3, 3], axis=0), axis=1)
    assert steps.max() < 0.8 and steps.min() > 0.5
    final = evaluate(result.poses, drive.poses).final_translation_percent
    assert final is not None and final < 1.0


def test_a_pair_across_a_lost_frame_carries_the_path_over_it(exact: Drive) -> None:
    rng = np.random.default_rng(6)
    two = tracks_of(exact.poses[[49, 51]], exact.extrinsics[[49, 51]], rng, 0.0, 0.0)[1]
    assert two is not None
    tracks = list(exact.tracks)
    tracks[50], tracks[51] = None, Tracks(two.points, two.on_road, 49)
    result = trajectory(pack_tracks(CAMERA, tracks), exact.extrinsics, TrajectorySettings())
    assert result.gaps == ((50, 50),)
    assert np.abs(result.poses[50, :3, 3] - exact.poses[50, :3, 3]).max() < 0.02
    assert np.abs(result.poses[-1, :3, 3] - exact.poses[-1, :3, 3]).max() < 0.05


def test_moving_points_do_not_pull_the_path(drive: Drive) -> None:
    """A third of the points off the road belongs to a car that drives beside."""
    rng = np.random.default_rng(7)
    tracks: list[Tracks | None] = [None]
    for pair in drive.tracks[1:100]:
        assert pair is not None
        points = pair.points.copy()
        car = np.flatnonzero(~pair.on_road)[::3]
        points[car, 3:5] = points[car, :2] + rng.normal(0, 0.2, (len(car), 2)).astype(np.float32)
        tracks.append(Tracks(points, pair.on_road, pair.previous))
    result = trajectory(pack_tracks(CAMERA, tracks), drive.extrinsics[:100], TrajectorySettings())
    final = evaluate(result.poses, drive.poses[:100]).final_translation_percent
    assert final is not None and final < 1.0


def test_the_same_input_gives_the_same_bits(drive: Drive) -> None:
    for settings in VARIANTS.values():
        a = trajectory(pack_tracks(CAMERA, drive.tracks), drive.extrinsics, settings)
        b = trajectory(pack_tracks(CAMERA, drive.tracks), drive.extrinsics, settings)
        assert np.array_equal(a.poses, b.poses) and np.array_equal(a.covariance, b.covariance)


def test_extrinsics_of_another_drive_are_refused(drive: Drive) -> None:
    with pytest.raises(ConfigError, match="extrinsics"):
        trajectory(drive.packed, drive.extrinsics[:-1], TrajectorySettings())


@pytest.mark.wall_clock
def test_a_variant_is_computed_at_the_touch_of_a_slider(drive: Drive) -> None:
    """Processor time, twice what two free cores have in 50 ms per 1,100 frames; `make bench` prints the real figure."""
    settings = TrajectorySettings(pitch_error_rad=0.01)
    trajectory(drive.packed, drive.extrinsics, settings)
    times = []
    for _ in range(5):
        began = time.process_time()
        trajectory(drive.packed, drive.extrinsics, settings)
        times.append(time.process_time() - began)
    assert min(times) / FRAMES < 2 * 2 * 50e-3 / 1100


def test_a_drive_that_never_shows_its_road_goes_on_by_points_above_it(drive: Drive) -> None:
    tracks: list[Tracks | None] = [None]
    for pair in drive.tracks[1:60]:
        assert pair is not None
        tracks.append(Tracks(pair.points[~pair.on_road], pair.on_road[~pair.on_road], pair.previous))
    packed = pack_tracks(CAMERA, tracks, np.zeros(60, dtype=bool))
    for settings in (TrajectorySettings(), TrajectorySettings("planar")):
        result = trajectory(packed, np.full((60, 4), np.nan), settings)
        assert result.gaps == ((1, 59),)
        final = evaluate(result.poses, drive.poses[:60]).final_translation_percent
        assert final is not None and final < 3.0


@pytest.mark.parametrize("count", [0, 1, 2])
@pytest.mark.parametrize("model", ["full", "planar", "nonholonomic"])
def test_drives_of_hardly_any_frames(count: int, model: str) -> None:
    extrinsics = np.tile([1.65, 0.0, 0.0, 0.0], (count, 1))
    result = trajectory(pack_tracks(CAMERA, [None] * count), extrinsics, TrajectorySettings(model=model))  # type: ignore[arg-type]
    assert result.poses.shape == (count, 4, 4)
    assert np.array_equal(result.poses, np.tile(np.eye(4), (count, 1, 1)))
    assert result.gaps == (((1, 1),) if count == 2 else ())
