"""Rendered sets against their sigma, as the command beside the documentation's figures counts them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stereocalib_core.boards import calibrate, detect, open_folder
from stereocalib_core.boards.next_pose import LIMITS, next_pose
from stereocalib_core.boards.rotations import rotation_from_vector
from stereocalib_core.boards.synth import SynthSettings, write_set
from stereocalib_core.experiments import boards_sigma
from stereocalib_core.experiments.boards_sigma import Coverage, error_of
from stereocalib_core.geometry import transform
from stereocalib_core.numeric.arrays import Array


def test_coverage_of_known_errors() -> None:
    rng = np.random.default_rng(0)
    sigmas = rng.uniform(0.5, 2.0, (4000, 6))
    held = Coverage(sigmas * rng.standard_normal((4000, 6)), sigmas)
    np.testing.assert_allclose(held.within(1.0), 0.683, atol=0.03)
    np.testing.assert_allclose(held.within(2.0), 0.954, atol=0.015)
    np.testing.assert_allclose(held.rms(), 1.0, atol=0.05)
    table = boards_sigma.table(held, Coverage(3 * held.errors, sigmas))
    assert "4000 rendered sets" in table
    assert "| fixed | within 1 sigma [%] | 6" in table
    assert "| refined | within 1 sigma [%] | 2" in table


@pytest.fixture(scope="module")
def measured() -> tuple[Coverage, Coverage]:
    return boards_sigma.measure([300], pairs=8)


@pytest.mark.parametrize("kind", [0, 1])
def test_a_rendered_set_lies_within_its_sigma(measured: tuple[Coverage, Coverage], kind: int) -> None:
    coverage = measured[kind]
    assert coverage.errors.shape == (1, 6)
    assert np.all(np.abs(coverage.errors) < 4.0 * coverage.sigmas)
    # A sigma that holds because it is huge would be no answer.
    assert np.all(coverage.sigmas[:, :3] < np.deg2rad(1.0))
    assert np.all(coverage.sigmas[:, 3:] < 0.04)


def weak_poses(rng: np.random.Generator) -> list[Array]:
    """T_camera_board of five boards turned about their upright axis only, as most people hold them."""
    poses: list[Array] = []
    while len(poses) < 5:
        tilt = np.deg2rad([rng.uniform(-2, 2), rng.uniform(-35, 35), rng.uniform(-5, 5)])
        place = np.array([rng.uniform(-0.5, 0.5), rng.uniform(-0.25, 0.25), rng.uniform(2.4, 3.4)])
        poses.append(transform(rotation_from_vector(tilt), place))
    return poses


def test_the_pose_that_is_asked_for_halves_the_worst_sigma(tmp_path: Path) -> None:
    """Rendered as it was asked for, seen by both sensors, and solved with the rest."""
    poses, settings = weak_poses(np.random.default_rng(3)), SynthSettings(seed=3)
    write_set(tmp_path / "five", settings, poses=poses)
    five = detect(open_folder(tmp_path / "five"))
    before = calibrate(five.observations, five.board, five.camera)
    asked = next_pose(five.observations, before, five.board)
    assert asked is not None
    write_set(tmp_path / "six", settings, poses=[*poses, asked.T_camera_board])
    six = detect(open_folder(tmp_path / "six"))
    after = calibrate(six.observations, six.board, six.camera)
    assert sum(p.ok for p in before.pairs) == 5
    assert sum(p.ok for p in after.pairs) == 6
    worst = int(np.argmax(np.sqrt(np.diag(before.covariance)) / LIMITS))
    sigma = np.sqrt(after.covariance[worst, worst])
    assert sigma < 0.5 * np.sqrt(before.covariance[worst, worst])
    # What was promised is what came of it.
    assert sigma == pytest.approx(asked.sigma_after[worst], rel=0.4)
    assert np.all(np.abs(error_of(after)) < 4.0 * np.sqrt(np.diag(after.covariance)))
