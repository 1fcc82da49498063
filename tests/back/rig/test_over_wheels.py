"""The camera over the road under its wheels, on a road that banks and rises ahead."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from body_on_springs import DIRECT, as_results, measure, ride

from stereocalib_core.back.rig.body_motion import MotionSeries
from stereocalib_core.back.rig.over_wheels import over_wheels
from stereocalib_core.back.rig.shift_alarm import find_shifts
from stereocalib_core.results import Shift

STEP_M, AHEAD_M = 0.9, 7.0
AXES = ("height", "pitch", "roll")
SIZES = (0.03, float(np.deg2rad(0.3)), float(np.deg2rad(0.3)))


def bank(s_m: np.ndarray) -> np.ndarray:
    """The road's tilt across along the drive: curves banked by two degrees, reached over 12 m."""
    wave = np.sin(2 * np.pi * s_m / 130.0)
    return (
        np.deg2rad(2.0) * np.clip(2.0 * wave - np.sign(wave), 0.0, 1.0) * np.sign(wave) * (np.abs(wave) > 0.5)
    )


def about_x(angle: np.ndarray) -> np.ndarray:
    c, s, o, z = np.cos(angle), np.sin(angle), np.ones_like(angle), np.zeros_like(angle)
    return np.moveaxis(np.array([[o, z, z], [z, c, -s], [z, s, c]]), -1, 0)


def about_z(angle: np.ndarray) -> np.ndarray:
    c, s, o, z = np.cos(angle), np.sin(angle), np.ones_like(angle), np.zeros_like(angle)
    return np.moveaxis(np.array([[c, -s, z], [s, c, z], [z, z, o]]), -1, 0)


def banked(body: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values over the road ahead and (N, 4, 4) poses of a camera whose body moves over its wheels as (N, 3)."""
    s = STEP_M * np.arange(len(body))
    height, pitch, roll = body.T
    poses = np.tile(np.eye(4), (len(body), 1, 1))
    poses[:, :3, :3] = np.swapaxes(about_x(pitch) @ about_z(roll + bank(s)), 1, 2)
    poses[:, 1, 3], poses[:, 2, 3] = -height, s
    ahead = np.column_stack([height, pitch, roll + bank(s) - bank(s + AHEAD_M)])
    return ahead, poses


def alarm(ahead: np.ndarray, motion: MotionSeries, poses: np.ndarray, seed: int) -> tuple[Shift, ...]:
    z, covariance = measure(ahead, DIRECT, seed)
    moving = dataclasses.replace(
        motion, speed=np.full(len(z), 10 * STEP_M), yaw_rate=np.zeros(len(z)), poses=poses
    )
    return find_shifts(as_results(z, covariance, motion.timestamps_s), moving)


def test_the_bank_of_the_road_ahead_is_taken_out() -> None:
    drive = ride(400, straight=True)
    ahead, poses = banked(drive.truth)
    assert np.rad2deg(np.abs(ahead[:, 2] - drive.truth[:, 2]).max()) > 1.0
    motion = MotionSeries(drive.time_s, np.full(400, 9.0), np.zeros(400), poses)
    found = over_wheels(ahead, motion)
    assert np.isnan(found[:6]).all() and np.isfinite(found[10:]).all()
    error = np.abs(found - drive.truth)[10:]
    assert error[:, 0].max() < 1e-3
    assert np.rad2deg(error[:, 1:].max()) < 0.08


def test_nothing_is_carried_over_a_lost_stretch() -> None:
    drive = ride(120, straight=True)
    ahead, poses = banked(drive.truth)
    tracked = np.arange(120) != 60
    found = over_wheels(ahead, MotionSeries(drive.time_s, np.full(120, 9.0), np.zeros(120), poses, tracked))
    assert np.isfinite(found[20:60]).all()
    assert np.isnan(found[60:66]).all()
    assert np.isfinite(found[70:]).all()


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("seed", range(2))
def test_a_knock_where_the_road_banks_is_found_and_nothing_else(axis: int, seed: int) -> None:
    drive = ride(400, seed, straight=True)
    ahead, poses = banked(drive.truth)
    assert alarm(ahead, drive.motion, poses, seed) == ()
    at = 250 + int(np.argmax(np.abs(np.diff(bank(STEP_M * np.arange(250, 400) + AHEAD_M)))))
    body = drive.truth.copy()
    body[at:, axis] += SIZES[axis]
    ahead, poses = banked(body)
    found = alarm(ahead, drive.motion, poses, seed)
    assert [(s.axis, s.kind, s.frame) for s in found] == [(AXES[axis], "step", at)]
    assert found[0].size == pytest.approx(SIZES[axis], rel=0.2)


def test_a_roll_that_creeps_is_told_from_roads_that_bank() -> None:
    drive, size = ride(700, 1, straight=True), float(np.deg2rad(0.4))
    body = drive.truth.copy()
    body[:, 2] += size * np.clip((np.arange(700) - 150) / 400, 0.0, 1.0)
    ahead, poses = banked(body)
    found = alarm(ahead, drive.motion, poses, 1)
    assert [(s.axis, s.kind) for s in found] == [("roll", "drift")]
    assert found[0].size == pytest.approx(size, rel=0.3)


def test_a_slip_of_the_odometry_is_no_knock() -> None:
    drive = ride(400, straight=True)
    ahead, poses = banked(drive.truth)
    slip = np.eye(4)
    slip[:3, :3] = about_x(np.array([np.deg2rad(0.4)]))[0]
    slipped = poses.copy()
    slipped[200:] = poses[200] @ slip @ np.linalg.inv(poses[200]) @ poses[200:]
    assert alarm(ahead, drive.motion, slipped, 0) == ()
