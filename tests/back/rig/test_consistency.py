"""No frame that is ok contradicts the rig of the end, whatever the frames say."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from stereocalib_core.back.analyse import analyse
from stereocalib_core.back.rig.consistency import near_smoothed, settled
from stereocalib_core.config import ConsistencyConfig, PipelineConfig
from stereocalib_core.errors import FailureReason
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.results import FrameResult, RoadEstimate

CAMERA = StereoCamera(1226, 370, 707.0912, 601.8873, 183.1104, 0.53715)
SIGMA = np.array([0.004, *np.deg2rad([0.03, 0.06])])


def results_of(values: np.ndarray) -> list[FrameResult]:
    """Frames that say `values` (N, 3) height [m], pitch, roll [rad], all equally sure."""
    covariance = np.diag(SIGMA**2)
    return [
        FrameResult(
            i, 0.1 * i, RoadEstimate(Extrinsics(*map(float, v)), covariance, 1000, 0.5, (4.0, 20.0)), None
        )
        for i, v in enumerate(values)
    ]


@pytest.mark.parametrize("height_m", [0.4, 1.65, 3.2])
def test_no_frame_that_is_ok_is_far_from_the_smoothed_rig(height_m: float) -> None:
    """A third of the frames is anywhere, in runs long enough to pull the smoother along."""
    rng = np.random.default_rng(2)
    values = np.tile([height_m, 0.01, -0.005], (240, 1)) + rng.normal(0, SIGMA, (240, 3))
    for first in range(15, 240, 30):
        values[first : first + 10] += rng.normal(0, [0.25 * height_m, 0.06, 0.08], 3)
    drive = analyse(results_of(values), CAMERA, PipelineConfig())
    ok = drive.frames.ok
    assert 100 <= ok.sum() < 240
    off = np.abs(values - drive.frames.smoothed)[ok]
    far = (off > [0.15, *np.deg2rad([1.5, 1.5])]) & (off > 4.0 * SIGMA)
    assert not far.any()


def test_what_is_left_out_says_by_how_much() -> None:
    values = np.tile([1.65, 0.01, -0.005], (3, 1))
    values[1, 0] += 0.16
    smoothed = np.tile([1.65, 0.01, -0.005], (3, 1))
    checked = near_smoothed(results_of(values), smoothed, ConsistencyConfig())
    assert [r.ok for r in checked] == [True, False, True]
    failure = checked[1].failure
    assert failure is not None and failure.reason is FailureReason.INCONSISTENT
    assert "+0.16 m, 40 sigma" in failure.detail


@pytest.mark.parametrize(("off_deg", "left"), [(0.5, 0.0), (2.5, 1.0)])
def test_the_first_pairs_doubt_is_settled_by_the_frames_after(off_deg: float, left: float) -> None:
    """Whose road it is: gone where the frames after see it too, kept where they see another."""
    values = np.tile([1.65, 0.01, -0.005], (20, 1))
    values[0, 1] += np.deg2rad(off_deg)
    frames, alone = results_of(values), (0.009, 0.023)
    road = frames[0].road
    assert road is not None
    frames[0] = dataclasses.replace(frames[0], road=dataclasses.replace(road, alone=alone))
    settings = PipelineConfig()
    first, *rest = settled(frames, settings.consistency, settings.region)
    assert first.road is not None and rest == frames[1:]
    assert first.road.alone == pytest.approx(np.multiply(left, alone))
    told = analyse(frames, CAMERA, settings).frames
    assert told.sigma[0] == pytest.approx(first.road.sigma)
    # too few frames after it say nothing
    assert settled(frames[:4], settings.consistency, settings.region) == frames[:4]


def test_a_doubt_of_roll_alone_is_settled_as_well() -> None:
    frames = results_of(np.tile([1.65, 0.01, -0.005], (20, 1)))
    road = frames[0].road
    assert road is not None
    frames[0] = dataclasses.replace(frames[0], road=dataclasses.replace(road, alone=(0.0, 0.02)))
    settings = PipelineConfig()
    first = settled(frames, settings.consistency, settings.region)[0]
    assert first.road is not None and first.road.alone == (0.0, 0.0)
