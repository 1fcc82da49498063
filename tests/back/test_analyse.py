"""The whole back end on simulated tracks: what it hands from room to room."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent / "odometry"))
from simulated_drive import CAMERA, camera_poses, car_path, mount_series, tracks_of

from stereocalib_core.back.analyse import STEREO_ONLY, SUFFIXES, analyse
from stereocalib_core.back.odometry.trajectory import VARIANTS
from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import Failure, FailureReason
from stereocalib_core.frames import GroundTruth
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.results import Drive, FrameResult, RoadEstimate

FRAMES = 250
YAW = np.deg2rad(-0.3)


def drive_of(seen: float = 1.0, failed: range = range(0)) -> Drive:
    """A drive whose frames say `seen` times their true pitch and roll."""
    rng = np.random.default_rng(4)
    extrinsics = mount_series(FRAMES, rng, 1.0)
    poses = camera_poses(car_path(FRAMES, YAW, 0.95), extrinsics)
    tracks = tracks_of(poses, extrinsics, rng, 0.25, 0.1)
    covariance = np.diag(np.square([0.002, *np.deg2rad([0.01, 0.02])]))
    results = []
    for i, (height, pitch, roll) in enumerate(extrinsics[:, :3].tolist()):
        road = RoadEstimate(Extrinsics(height, seen * pitch, seen * roll), covariance, 1000, 0.5, (4.0, 20.0))
        failure = Failure(FailureReason.NO_ROAD, "a truck") if i in failed else None
        results.append(FrameResult(i, 0.1 * i, None if failure else road, failure, tracks=tracks[i]))
    return analyse(results, CAMERA, PipelineConfig(), GroundTruth(poses))


@pytest.fixture(scope="module")
def drive() -> Drive:
    return drive_of()


def percent(drive: Drive, name: str) -> float:
    value = drive.paths[name].errors.final_translation_percent
    assert value is not None
    return value


def test_every_variant_in_every_model_and_the_path_without_a_road(drive: Drive) -> None:
    assert set(drive.paths) == {n + s for n in VARIANTS for s in SUFFIXES} | {STEREO_ONLY}
    for model in SUFFIXES:
        assert percent(drive, f"autocalibrated{model}") < 0.6
        assert percent(drive, f"no_pitch_no_roll{model}") > 3 * percent(drive, f"autocalibrated{model}")
    assert percent(drive, "no_yaw_nonholonomic") > 3 * percent(drive, "autocalibrated_nonholonomic")


def test_what_the_frames_say_drives_the_odometry(drive: Drive) -> None:
    """Pitch and roll tripled on their way into the odometry: every model but stereo alone ends elsewhere."""
    wrong = drive_of(3.0)
    for model in SUFFIXES:
        name = f"autocalibrated{model}"
        assert percent(wrong, name) > 3 * percent(drive, name), name
    np.testing.assert_array_equal(wrong.paths[STEREO_ONLY].poses, drive.paths[STEREO_ONLY].poses)


def test_a_drive_that_shows_no_road_most_of_the_way_is_a_gap() -> None:
    blind = drive_of(failed=range(20, FRAMES))
    errors = blind.paths["autocalibrated"].errors
    assert errors.path_m is None and errors.final_translation_percent is None and errors.t_rel_percent is None
    assert errors.measured_percent is not None and errors.measured_percent < 15
    assert blind.gaps == ((20, FRAMES - 1),)
    assert blind.why_not is not None and "gap" in blind.why_not
    some = drive_of(failed=range(100, 120))
    assert some.gaps == ((100, 119),)
    assert some.paths["autocalibrated"].errors.final_translation_percent is not None


def test_odometry_uses_smoothed_and_files_have_both(drive: Drive) -> None:
    frames = drive.frames
    assert np.isfinite(frames.filtered).all() and np.isfinite(frames.smoothed).all()
    assert not np.array_equal(frames.filtered, frames.smoothed)
    assert (frames.smoothed_sigma <= frames.filtered_sigma + 1e-9).mean() > 0.9


def test_steps_too_long_for_tracks_are_said_and_are_no_standstill() -> None:
    results = [
        FrameResult(
            i, 0.8 * i, RoadEstimate(Extrinsics(1.65, 0.01, 0.0), np.eye(3) * 1e-6, 9, 0.5, (4.0, 20.0))
        )
        for i in range(6)
    ]
    lost = analyse(results, CAMERA, PipelineConfig())
    assert lost.paths["autocalibrated"].errors.path_m is None
    assert lost.gaps == ((1, 5),)
    assert lost.yaw_reason is not None and "5 have no tracks" in lost.yaw_reason
    assert lost.why_not is not None and "too long" in lost.why_not
