"""The whole chain on rendered planes of exactly known height, pitch and roll."""

from __future__ import annotations

import numpy as np
import pytest

from stereocalib_core.config import DirectConfig, PipelineConfig
from stereocalib_core.errors import FailureReason
from stereocalib_core.front.road.estimate import begin_road, estimate_road, finish_road
from stereocalib_core.front.road.plane import across_of
from stereocalib_core.front.road.surface import (
    bends,
    beside,
    fit_lane,
    further_bends,
    own_unevenness,
    row_covariance,
    unseen_share,
)
from stereocalib_core.front.road.variants import eq12_roll
from stereocalib_core.geometry import Extrinsics, StereoCamera, invert_transform
from stereocalib_core.simulator.plane import render_plane
from stereocalib_core.sources.formats.synthetic import SyntheticSource

CAMERA = StereoCamera(1226, 370, 707.0912, 601.8873, 183.1104, 0.53715)
COUNT = 48


def _run(clutter: bool, count: int) -> dict[str, np.ndarray]:
    """Errors and sigmas (N, 3) of height [m], pitch, roll [deg] of both methods over +-5 deg of roll."""
    rng = np.random.default_rng(5)
    found: dict[str, list[np.ndarray]] = {
        name: [] for name in ("eq12", "paper", "paper_sigma", "direct", "direct_sigma")
    }
    unit = np.array([1.0, *np.rad2deg([1.0, 1.0])])
    for k in range(count):
        height, pitch = 1.65 + rng.uniform(-0.1, 0.1), 0.8 + rng.uniform(-0.5, 0.5)
        truth = Extrinsics.from_degrees(height, pitch, -5.0 + 10.0 * k / (count - 1))
        left, right = render_plane(CAMERA, truth, seed=k, clutter=clutter, exposure_difference=0.05)[:2]
        road = estimate_road(left, right, CAMERA, PipelineConfig())
        assert road.estimate is not None and road.paper is not None, road.failure
        assert road.drawable
        alone = eq12_roll(road.disparity, road.free, CAMERA, PipelineConfig())
        assert alone is not None
        found["eq12"].append(np.array([np.rad2deg(alone) - truth.roll_deg]))
        fits = {"paper": (road.paper.extrinsics, road.paper.covariance),
                "direct": (road.estimate.extrinsics, road.estimate.covariance)}  # fmt: skip
        for name, (e, covariance) in fits.items():
            error = [e.height_m - truth.height_m, e.pitch_deg - truth.pitch_deg, e.roll_deg - truth.roll_deg]
            found[name].append(np.array(error))
            found[name + "_sigma"].append(np.sqrt(np.diag(covariance)) * unit)
    return {name: np.array(values) for name, values in found.items()}


@pytest.fixture(scope="module")
def clean() -> dict[str, np.ndarray]:
    return _run(False, COUNT)


def test_paper_roll_and_pitch(clean: dict[str, np.ndarray]) -> None:
    error = clean["paper"]
    assert np.median(np.abs(clean["eq12"])) <= 0.01
    assert abs(error[:, 1].mean()) <= 0.06
    assert np.abs(error[:, 1]).max() <= 0.06, "over the whole range of roll"


def test_direct_is_a_hundredth_of_a_degree(clean: dict[str, np.ndarray]) -> None:
    error = clean["direct"]
    assert np.median(np.abs(error[:, 2])) <= 0.005
    assert error[:, 2].std() <= 0.01
    assert abs(error[:, 1].mean()) <= 0.005
    assert abs(error[:, 0].mean()) <= 0.001


@pytest.mark.parametrize("method", ["paper", "direct"])
def test_sigma_means_something(clean: dict[str, np.ndarray], method: str) -> None:
    error, sigma, of_noise = np.abs(clean[method]), clean[method + "_sigma"], clean[method + "_sigma"]
    if method == "paper":
        # what real roads add is a constant of the settings (the town judges it below): a plane has less of it
        c = PipelineConfig().profile
        of_roads = c.systematic_height_m, c.systematic_pitch_deg, c.systematic_roll_deg
        of_noise = np.sqrt(sigma**2 - np.square(of_roads))
    assert np.mean(error < sigma) >= 0.55
    assert np.mean(error < 2.0 * sigma) >= 0.9
    # sigma of `direct` allows for how roads bend: on a perfect plane that is room to spare
    within = np.mean(error < of_noise)
    assert within <= (0.85 if method == "paper" else 0.97), f"{within:.0%} within one sigma"
    assert np.sqrt(np.mean((error / of_noise) ** 2)) > 0.4


@pytest.fixture(scope="module")
def town() -> dict[str, np.ndarray]:
    """Errors over sigma (N, 3) of height, pitch, roll on every 17th frame of the town, by both methods."""
    source = SyntheticSource.from_spec("synthetic:town")
    truth = source.ground_truth.extrinsics
    assert truth is not None
    found: dict[str, list[np.ndarray]] = {"paper": [], "direct": []}
    for k in range(5, len(source), 17):
        frame = source[k]
        assert frame.left is not None and frame.right is not None
        begun = begin_road(frame.left, frame.right, source.camera, PipelineConfig())
        for method in found:
            config = PipelineConfig(method=method)
            road = finish_road(begun, frame.left, frame.right, source.camera, config)
            if road.estimate is not None:
                e = road.estimate.extrinsics
                error = np.array([e.height_m, e.pitch_rad, e.roll_rad]) - truth[k, :3]
                found[method].append(error / road.estimate.sigma)
    return {method: np.array(values) for method, values in found.items()}


@pytest.mark.parametrize("method", ["paper", "direct"])
def test_sigma_in_the_town_is_honest(town: dict[str, np.ndarray], method: str) -> None:
    ratio = np.abs(town[method])
    assert len(ratio) >= 45
    once, twice = np.mean(ratio < 1.0, axis=0), np.mean(ratio < 2.0, axis=0)
    # 51 frames: the shares themselves have a sigma of 6 and 4 %
    assert np.all((once >= 0.5) & (once <= 0.9)), once
    assert np.all(twice >= 0.84), twice


def test_patches_that_are_not_the_road_are_rejected() -> None:
    """A sixth of the patches, all on one side, lie a sill too high: the plane stays, they lose their weight."""
    rng = np.random.default_rng(4)
    config = DirectConfig()
    z, x = rng.uniform(4.5, 19.5, 150), rng.uniform(-1.7, 1.7, 150)
    height_m, fb = 1.65, CAMERA.focal_px * CAMERA.baseline_m
    px_per_m = fb / (height_m * z)
    J = np.column_stack([CAMERA.focal_px * height_m / z, CAMERA.focal_px * x / z, np.ones(150)])
    J = np.hstack([J, bends(x, z, config) * px_per_m[:, None]])
    offset = rng.normal(0.0, 0.05, 150)
    thing = (x > 0.6) & (z < 14.0)
    offset[thing] += 0.15 * px_per_m[thing]
    assert 20 <= thing.sum() <= 40
    fit = fit_lane(J, offset, np.full(150, 0.05**2), config)
    assert fit.robust[thing].max() < 0.1 and np.median(fit.robust[~thing]) > 0.7
    sigma = np.sqrt(np.diag(fit.covariance))
    assert (np.abs(fit.solution)[:3] < 4.0 * sigma[:3]).all()
    # pixels of the plane, at the far corner of the lane
    assert np.abs(J[:, :3] @ fit.solution[:3]).max() < 0.2


def test_a_lane_that_bends_along_is_not_taken_for_pitch() -> None:
    """15 mm of sag, seen where patches are dense, near by: a plane alone would follow them."""
    rng = np.random.default_rng(5)
    config = DirectConfig()
    z, x = 4.5 + 15.0 * rng.uniform(0.0, 1.0, 300) ** 2, rng.uniform(-1.7, 1.7, 300)
    height_m, fb = 1.65, CAMERA.focal_px * CAMERA.baseline_m
    px_per_m = fb / (height_m * z)
    shapes = bends(x, z, config)
    J = np.column_stack([CAMERA.focal_px * height_m / z, CAMERA.focal_px * x / z, np.ones(300)])
    J = np.hstack([J, shapes * px_per_m[:, None]])
    offset = rng.normal(0.0, 0.02, 300) + 0.015 * shapes[:, 2] * px_per_m
    fit = fit_lane(J, offset, np.full(300, 0.02**2), config)
    sigma = np.sqrt(np.diag(fit.covariance))
    assert fit.solution[5] == pytest.approx(0.015, abs=0.003)
    assert (np.abs(fit.solution[:3]) < 3.0 * sigma[:3]).all()
    alone = fit_lane(np.delete(J, 5, axis=1), offset, np.full(300, 0.02**2), config)
    assert np.abs(J[:, :3] @ fit.solution[:3]).max() < 0.3 * np.abs(J[:, :3] @ alone.solution[:3]).max()


def test_a_crown_that_swings_aside_ahead_is_not_taken_for_roll() -> None:
    """8 mm of it where the road turns ahead, seen where patches are dense, near by; a flat lane stays as it was."""
    rng = np.random.default_rng(2)
    config = DirectConfig()
    z, x = 4.5 + 15.0 * rng.uniform(0.0, 1.0, 400) ** 2, rng.uniform(-1.7, 1.7, 400)
    height_m, fb = 1.65, CAMERA.focal_px * CAMERA.baseline_m
    px_per_m = fb / (height_m * z)
    further = further_bends(x, z, config)
    J = np.column_stack([CAMERA.focal_px * height_m / z, CAMERA.focal_px * x / z, np.ones(400)])
    J = np.hstack([J, bends(x, z, config) * px_per_m[:, None]])
    more = further * px_per_m[:, None], unseen_share(x, z, config)
    noise, variance = rng.normal(0.0, 0.02, 400), np.full(400, 0.02**2)
    swings = noise + 0.008 * further[:, 1] * px_per_m
    found, without = (fit_lane(J, swings, variance, config, *extra) for extra in (more, ()))
    assert abs(found.solution[1]) < 0.3 * abs(without.solution[1])
    assert abs(found.solution[1]) < 3.0 * np.sqrt(found.covariance[1, 1])
    flat, as_before = (fit_lane(J, noise, variance, config, *extra) for extra in (more, ()))
    assert np.sqrt(flat.covariance[1, 1] / as_before.covariance[1, 1]) == pytest.approx(1.0, abs=0.1)


def test_a_road_that_breaks_off_at_the_lanes_edge_is_not_taken_for_roll() -> None:
    """The next lane falls by 1 % less than the own one goes on to; only the lane is meant."""
    rng = np.random.default_rng(3)
    config = DirectConfig()
    z, x = 4.5 + 15.0 * rng.uniform(0.0, 1.0, 400) ** 2, rng.uniform(-2.4, 2.4, 400)
    height_m, fb = 1.65, CAMERA.focal_px * CAMERA.baseline_m
    px_per_m = fb / (height_m * z)
    J = np.column_stack([CAMERA.focal_px * height_m / z, CAMERA.focal_px * x / z, np.ones(400)])
    J = np.hstack([J, bends(x, z, config) * px_per_m[:, None]])
    off_lane = beside(x, config) * px_per_m[:, None]
    noise, variance = rng.normal(0.0, 0.02, 400), np.full(400, 0.02**2)
    breaks = noise + 0.01 * np.maximum(x - 1.75, 0.0) * px_per_m
    found, without, flat = (
        fit_lane(J, offset, variance, config, None, 0.0, *extra)
        for offset, extra in ((breaks, (off_lane,)), (breaks, ()), (noise, (off_lane,)))
    )
    # what is left is the noise's own
    assert abs(found.solution[1] - flat.solution[1]) < abs(without.solution[1] - flat.solution[1]) / 3.0
    assert abs(found.solution[1]) < 2.0 * np.sqrt(found.covariance[1, 1])


def test_what_a_row_of_patches_shares_comes_out_as_it_goes_in() -> None:
    rng = np.random.default_rng(6)
    v = rng.integers(20, 40, 200)
    J = np.column_stack([v - 10.0, rng.uniform(-300, 300, 200), np.ones(200)])
    nothing = np.zeros(200)
    fit = fit_lane(np.hstack([J, 1e-9 * rng.normal(size=(200, 3))]), nothing, np.ones(200), DirectConfig())
    told = row_covariance(fit, v, 0.01)
    drawn = fit.gain @ rng.normal(0.0, 0.01, (40, 4000))[v]
    np.testing.assert_allclose(told[:3, :3], np.cov(drawn)[:3, :3], rtol=0.15, atol=0.05 * told[0, 0])
    assert told[2, 2] > 3.0 * np.sum((0.01 * fit.gain[2]) ** 2), "and is more than if each had it by itself"


@pytest.mark.parametrize("roll_deg", [-12.0, 0.4])
def test_the_lane_lies_under_the_camera_whose_picture_leans(roll_deg: float) -> None:
    rig = Extrinsics.from_degrees(1.65, 6.0, roll_deg)
    X, Z = np.array([-1.75, 0.0, 1.75]), np.array([5.0, 8.0, 19.0])
    T = invert_transform(rig.T_vehicle_camera)
    x, y, z = T[:3, :3] @ np.stack([X, np.zeros(3), Z]) + T[:3, 3:]
    u, v = CAMERA.focal_px * x / z, CAMERA.focal_px * y / z
    found = z * (np.column_stack([u, v, np.ones(3)]) @ across_of(rig, CAMERA.focal_px))
    np.testing.assert_allclose(found, X, atol=1e-9)


def test_bumps_of_the_road_itself_are_no_error_of_its_plane() -> None:
    """Against the least-squares plane of the bumpy lane: covered, and by less than half of what any road would need."""
    rng = np.random.default_rng(3)
    config = DirectConfig()
    z, x = rng.uniform(4.5, 19.5, 300), rng.uniform(-1.7, 1.7, 300)
    height_m, fb, uneven_m, noise_px = 1.65, CAMERA.focal_px * CAMERA.baseline_m, 0.01, 0.02
    px_per_m, area = fb / (height_m * z), np.ones(300)
    plane = np.column_stack([CAMERA.focal_px * height_m / z, CAMERA.focal_px * x / z, np.ones(300)])
    J = np.hstack([plane, bends(x, z, config) * px_per_m[:, None]])
    variance = noise_px**2 + (uneven_m * px_per_m) ** 2
    off, told, any_road = [], [], []
    for _ in range(40):
        bumps = rng.normal(0.0, uneven_m, 300)
        fit = fit_lane(J, bumps * px_per_m + rng.normal(0.0, noise_px, 300), variance, config)
        own = own_unevenness(fit, J, px_per_m, area, uneven_m * px_per_m)
        meant = np.linalg.lstsq(plane / px_per_m[:, None], bumps, rcond=None)[0]
        off.append(fit.solution[:3] - meant)
        told.append(np.diag(fit.covariance + own)[:3])
        any_road.append(np.diag(fit.covariance)[:3])
    ratio = np.sqrt(np.mean(np.square(off), axis=0) / np.mean(told, axis=0))
    assert np.all((ratio > 0.5) & (ratio < 1.4)), ratio
    assert np.all(np.mean(told, axis=0) < 0.25 * np.mean(any_road, axis=0))


def test_direct_with_half_of_the_road_covered() -> None:
    error = _run(True, 16)["direct"]
    assert np.median(np.abs(error[:, 1:]), axis=0) == pytest.approx([0.0, 0.0], abs=0.02)


def test_a_camera_with_shifted_principal_points_sees_the_same_road() -> None:
    truth = Extrinsics.from_degrees(1.6, 1.0, 0.5)
    left, right = render_plane(CAMERA, truth, seed=3)[:2]
    shifted = StereoCamera(1226, 370, 707.0912, 601.8873, 183.1104, 0.53715, cx_right_px=601.8873 - 7.0)
    moved = np.roll(right, -7, axis=1)
    road = estimate_road(left, moved, shifted, PipelineConfig())
    assert road.estimate is not None, road.failure
    assert road.estimate.extrinsics.pitch_deg == pytest.approx(1.0, abs=0.02)
    assert road.estimate.extrinsics.height_m == pytest.approx(1.6, abs=0.003)


def test_odd_rows_keep_exact_pixel_centres() -> None:
    camera = StereoCamera(1241, 375, 718.856, 607.1928, 185.2157, 0.5372)
    truth = Extrinsics.from_degrees(1.65, 0.5, -1.0)
    left, right = render_plane(camera, truth, seed=4)[:2]
    road = estimate_road(left, right, camera, PipelineConfig())
    assert road.paper is not None
    assert road.paper.extrinsics.pitch_deg == pytest.approx(0.5, abs=0.04)


def test_full_resolution_is_an_option() -> None:
    config = PipelineConfig(disparity={"scale": 1})  # type: ignore[arg-type]
    truth = Extrinsics.from_degrees(1.65, 0.8, 1.0)
    left, right = render_plane(CAMERA, truth, seed=6)[:2]
    road = estimate_road(left, right, CAMERA, config)
    assert road.disparity.values.shape == left.shape
    assert road.estimate is not None
    assert road.estimate.extrinsics.roll_deg == pytest.approx(1.0, abs=0.02)


def _grey(value: int) -> np.ndarray:
    return np.full((370, 1226), value, np.uint8)


def _wall() -> tuple[np.ndarray, np.ndarray]:
    texture = np.random.default_rng(0).integers(40, 220, (370, 1300)).astype(np.uint8)
    return texture[:, :1226].copy(), texture[:, 40:1266].copy()


def _noise() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    return (
        rng.integers(0, 255, (370, 1226)).astype(np.uint8),
        rng.integers(0, 255, (370, 1226)).astype(np.uint8),
    )


@pytest.mark.parametrize("method", ["paper", "direct"])
@pytest.mark.parametrize(
    ("pair", "reasons"),
    [
        ((_grey(3), _grey(3)), {FailureReason.DARK}),
        ((_grey(255), _grey(255)), {FailureReason.SATURATED}),
        ((_grey(128), _grey(128)), {FailureReason.FLAT_TEXTURE}),
        (_wall(), {FailureReason.NO_ROAD, FailureReason.NOT_PLANAR}),
        (_noise(), {FailureReason.NO_ROAD, FailureReason.NOT_PLANAR, FailureReason.NO_DISPARITY}),
    ],
    ids=["dark", "white", "flat", "wall", "noise"],
)
def test_a_pair_without_road_fails_with_its_reason(
    pair: tuple[np.ndarray, np.ndarray], reasons: set[FailureReason], method: str
) -> None:
    road = estimate_road(*pair, CAMERA, PipelineConfig(method=method))  # type: ignore[arg-type]
    assert road.estimate is None
    assert road.failure is not None and road.failure.reason in reasons, road.failure
    assert road.failure.detail


def test_arguments_are_not_changed() -> None:
    left, right = render_plane(CAMERA, Extrinsics.from_degrees(1.65, 0.5, 0.0), seed=8)[:2]
    copies = left.copy(), right.copy()
    first = estimate_road(left, right, CAMERA, PipelineConfig())
    second = estimate_road(left, right, CAMERA, PipelineConfig())
    assert np.array_equal(left, copies[0]) and np.array_equal(right, copies[1])
    assert first.estimate is not None and second.estimate is not None
    assert first.estimate.extrinsics == second.estimate.extrinsics, "a repeat gives the same bits"
