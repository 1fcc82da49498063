"""Shifts of the mount against the body's own motion, and the mount itself."""

from __future__ import annotations

import numpy as np
import pytest
from body_on_springs import DIRECT, MOUNT, PAPER, Ride, as_results, measure, ride

from stereocalib_core.back.rig.body_motion import MotionSeries, remove_explained
from stereocalib_core.back.rig.mount import estimate_mount
from stereocalib_core.back.rig.shift_alarm import find_shifts
from stereocalib_core.results import Shift

AXES = ("height", "pitch", "roll")
SIZES = (0.03, float(np.deg2rad(0.3)), float(np.deg2rad(0.3)))


def shifted(drive: Ride, axis: int, size: float, at: int, over: int = 1, seed: int = 1) -> np.ndarray:
    """Measurements of the drive with the mount moved by `size` from frame `at` on, growing over `over`."""
    truth = drive.truth.copy()
    truth[:, axis] += size * np.clip((np.arange(len(truth)) - at + 1) / over, 0.0, 1.0)
    return measure(truth, DIRECT, seed)[0]


def alarm(drive: Ride, z: np.ndarray, frames: int | None = None) -> tuple[Shift, ...]:
    n = frames or len(z)
    results = as_results(z[:n], np.diag(np.square(DIRECT)), drive.time_s[:n])
    m = drive.motion
    return find_shifts(results, MotionSeries(m.timestamps_s[:n], m.speed[:n], m.yaw_rate[:n]))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("sigma", [DIRECT, PAPER])
def test_no_alarm_without_a_shift(seed: int, sigma: tuple[float, float, float]) -> None:
    drive = ride(600, seed)
    z, covariance = measure(drive.truth, sigma, seed)
    assert find_shifts(as_results(z, covariance, drive.time_s), drive.motion) == ()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_knock_is_found_within_fifteen_frames_of_steady_driving(axis: int, sign: float, seed: int) -> None:
    drive = ride(300, seed, straight=True)
    found = alarm(drive, shifted(drive, axis, sign * SIZES[axis], 240, seed=seed), 255)
    assert [s.axis for s in found] == [AXES[axis]]
    assert abs(found[0].frame - 240) <= 2
    assert found[0].detected_at <= 255


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("axis", range(3))
def test_a_knock_amid_braking_and_curves_has_its_axis_and_size(axis: int, seed: int) -> None:
    drive = ride(600, seed)
    found = alarm(drive, shifted(drive, axis, SIZES[axis], 300, seed=seed))
    assert [s.axis for s in found] == [AXES[axis]]
    assert found[0].kind == "step"
    assert abs(found[0].frame - 300) <= 3
    assert found[0].size == pytest.approx(SIZES[axis], rel=0.25)


@pytest.mark.parametrize("axis", range(3))
def test_a_knock_soon_after_the_start_is_found(axis: int) -> None:
    drive = ride(80, 2, straight=True)
    z = shifted(drive, axis, SIZES[axis], 20)
    found = find_shifts(as_results(z, np.eye(3) * 1e-8, drive.time_s, range(8)), drive.motion)
    assert [s.axis for s in found] == [AXES[axis]]
    assert abs(found[0].frame - 20) <= 2


def test_what_comes_and_goes_is_two_shifts() -> None:
    drive = ride(600)
    z = shifted(drive, 2, SIZES[2], 200) - shifted(drive, 2, 0.0, 0) + shifted(drive, 2, -SIZES[2], 400)
    found = alarm(drive, z)
    assert [(s.axis, np.sign(s.size)) for s in found] == [("roll", 1.0), ("roll", -1.0)]


def test_a_drift_is_told_from_a_step() -> None:
    drive = ride(700)
    found = alarm(drive, shifted(drive, 1, float(np.deg2rad(0.5)), 200, over=400))
    assert [(s.axis, s.kind) for s in found] == [("pitch", "drift")]
    assert np.rad2deg(found[0].size) == pytest.approx(0.5, rel=0.3)
    assert 120 <= found[0].frame <= 300


def yaw_of_pairs(count: int = 400) -> np.ndarray:
    """What single pairs say of a yaw of -0.3 deg, with gaps as in bends."""
    yaw = np.deg2rad(-0.3 + 0.06 * np.random.default_rng(2).standard_normal(count))
    yaw[np.arange(count) % 100 > 70] = np.nan
    return yaw


def turned(motion: MotionSeries, at: int, size: float) -> MotionSeries:
    """The heading that a camera turned to the left by `size` between two frames sees besides."""
    rate = motion.yaw_rate.copy()
    rate[at] -= size / 0.1
    return MotionSeries(motion.timestamps_s, motion.speed, rate)


@pytest.mark.parametrize("at", [220, 285])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_camera_that_is_turned_is_found_on_straights_and_in_bends(at: int, sign: float) -> None:
    drive = ride(400)
    z, covariance = measure(drive.truth, DIRECT)
    results, yaw, size = as_results(z, covariance, drive.time_s), yaw_of_pairs(), sign * np.deg2rad(0.3)
    assert find_shifts(results, drive.motion, yaw) == ()
    yaw[at:] += size
    found = find_shifts(results, turned(drive.motion, at, size), yaw)
    assert [(s.axis, s.frame, s.kind) for s in found] == [("yaw", at, "step")]
    assert found[0].size == pytest.approx(size, rel=0.12)
    straight_since = np.isfinite(yaw[at + 1 : found[0].detected_at + 1]).sum()
    assert straight_since <= 60


def test_a_slip_of_the_odometry_is_no_turned_camera() -> None:
    drive = ride(400)
    z, covariance = measure(drive.truth, DIRECT)
    results = as_results(z, covariance, drive.time_s)
    assert find_shifts(results, turned(drive.motion, 220, float(np.deg2rad(0.3))), yaw_of_pairs()) == ()
    # and a yaw that jumps while the heading does not is no knock either
    yaw = yaw_of_pairs()
    yaw[220:] += np.deg2rad(0.3)
    assert not [s for s in find_shifts(results, drive.motion, yaw) if s.kind == "step"]
    # unless nobody saw the heading in between
    lost = drive.motion.yaw_rate.copy()
    lost[215:222] = np.nan
    found = find_shifts(results, MotionSeries(drive.time_s, drive.motion.speed, lost), yaw)
    assert [(s.axis, s.kind) for s in found] == [("yaw", "step")]


def test_braking_and_cornering_are_explained() -> None:
    drive = ride(600)
    rest = remove_explained(drive.truth, drive.motion)
    assert np.rad2deg(drive.truth[:, 1].std()) > 0.15
    assert np.rad2deg(rest[:, 1].std()) < 0.11
    assert np.rad2deg(rest[:, 2].std()) < 0.08


def test_the_mount_is_what_the_body_swings_about() -> None:
    drive = ride(900)
    z, covariance = measure(drive.truth, DIRECT)
    rig = estimate_mount(as_results(z, covariance, drive.time_s, range(50, 80)), drive.motion)
    for k, found in enumerate((rig.height_m, rig.pitch_rad, rig.roll_rad)):
        assert found is not None
        assert abs(found.value - MOUNT[k]) < 3 * found.sigma
    assert rig.pitch_rad is not None and np.rad2deg(rig.pitch_rad.sigma) < 0.03
    assert rig.yaw_rad is None


@pytest.mark.parametrize("count", [1, 8, 60])
def test_a_short_drive_is_no_surer_of_the_mount_than_springs_allow(count: int) -> None:
    """Over many drives the mount lies within its sigma as often as it should, however few frames there were."""
    within, twice = [], []
    for seed in range(40):
        drive = ride(120, seed)
        z, covariance = measure(drive.truth, DIRECT, seed)
        first = 3 * (seed % 10)
        results = as_results(z, covariance, drive.time_s)[first : first + count]
        rig = estimate_mount(results)
        for k, found in enumerate((rig.height_m, rig.pitch_rad, rig.roll_rad)):
            assert found is not None and found.sigma >= np.sqrt(covariance[k, k])
            within.append(abs(found.value - MOUNT[k]) < found.sigma)
            twice.append(abs(found.value - MOUNT[k]) < 2 * found.sigma)
    assert np.mean(within) > 0.55 and np.mean(twice) > 0.88, (np.mean(within), np.mean(twice))
    assert rig.note is not None and f"{count} frame" in rig.note or count == 60


def test_the_mount_is_the_one_after_the_last_knock() -> None:
    drive = ride(600)
    z = shifted(drive, 1, float(np.deg2rad(1.0)), 300)
    shifts = alarm(drive, z)
    rig = estimate_mount(as_results(z, np.eye(3) * 1e-8, drive.time_s), drive.motion, shifts=shifts)
    assert rig.pitch_rad is not None
    assert np.rad2deg(rig.pitch_rad.value - MOUNT[1]) == pytest.approx(1.0, abs=0.06)


def test_an_empty_drive_has_neither() -> None:
    assert find_shifts([]) == ()
    assert estimate_mount([]).height_m is None
