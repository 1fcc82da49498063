"""Knocks while the car goes over a speed hump."""

from __future__ import annotations

import numpy as np
import pytest
from body_on_springs import DIRECT, as_results, measure, ride

from stereocalib_core.back.rig.shift_alarm import MotionSeries, find_shifts
from stereocalib_core.back.rig.turmoil import find_hidden_step, wild_stretches

AT, LEAST, NOISE = 240, float(np.deg2rad(0.15)), float(np.deg2rad(0.015))
PULSE = np.deg2rad([-0.2, -1.2, -1.1, 0.3, 1.2, 1.0, 0.1, -0.3, 0.1])
"""Pitch as the front wheels and then the rear ones go over a hump."""


def over_a_hump(seed: int, size: float = 0.0, at: int = AT) -> np.ndarray:
    """(400,) measured pitch of a straight drive over a hump, from frame `at` on with a mount moved by `size`."""
    drive = ride(400, seed, straight=True)
    drive.truth[AT - 4 : AT + 5, 1] += PULSE
    drive.truth[at:, 1] += size
    return measure(drive.truth, DIRECT, seed)[0]


def test_a_hump_is_wild_and_a_knock_is_not() -> None:
    (first, stop), *others = wild_stretches(over_a_hump(0))
    assert not others
    assert first <= AT - 3 and AT + 2 <= stop <= AT + 15
    drive = ride(400, 0, straight=True)
    drive.truth[AT:, 1] += np.deg2rad(1.0)
    assert wild_stretches(measure(drive.truth, DIRECT, 0)[0]) == []


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("at", [AT - 2, AT, AT + 2])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_knock_on_a_hump_is_told_by_the_levels_around_it(seed: int, at: int, sign: float) -> None:
    size = sign * np.deg2rad(0.4)
    z = over_a_hump(seed, size, at)
    found = find_hidden_step(z[:, 1], wild_stretches(z), LEAST, NOISE)
    assert found is not None
    assert abs(found.onset - at) <= 7
    assert at + 30 <= found.certain <= at + 60
    assert abs(found.size - size) < 4 * found.sigma


@pytest.mark.parametrize("seed", range(6))
def test_a_hump_alone_is_no_knock(seed: int) -> None:
    z = over_a_hump(seed)
    stretches = wild_stretches(z)
    assert stretches
    assert find_hidden_step(z[:, 1], stretches, LEAST, NOISE) is None


def test_a_witness_that_shows_nothing_is_believed() -> None:
    z = over_a_hump(1, float(np.deg2rad(0.4)))
    stretches = wild_stretches(z)
    assert find_hidden_step(z[:, 1], stretches, LEAST, NOISE, z[:, 1]) is not None
    assert find_hidden_step(z[:, 1], stretches, LEAST, NOISE, over_a_hump(1)[:, 1]) is None


def test_too_short_a_drive_says_nothing() -> None:
    z = over_a_hump(1, float(np.deg2rad(0.4)))
    stretches = wild_stretches(z)
    assert find_hidden_step(z[: AT + 30, 1], stretches, LEAST, NOISE) is None
    assert find_hidden_step(z[AT - 40 :, 1], [(30, 45)], LEAST, NOISE) is None


def test_the_alarm_tells_it_with_its_axis() -> None:
    z, drive = over_a_hump(2, float(np.deg2rad(0.4))), ride(400, 2, straight=True)
    poses = np.tile(np.eye(4), (400, 1, 1))
    poses[:, 2, 3] = np.cumsum(0.1 * drive.motion.speed)
    motion = MotionSeries(drive.time_s, drive.motion.speed, drive.motion.yaw_rate, poses)
    found = find_shifts(as_results(z, np.diag(np.square(DIRECT)), drive.time_s), motion)
    assert [(s.axis, s.kind) for s in found] == [("pitch", "step")]
