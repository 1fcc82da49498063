"""What the pipeline reports for each fault: the right reason, and an honest estimate before and after."""

from __future__ import annotations

import numpy as np
import pytest

from stereocalib_core.config import PipelineConfig
from stereocalib_core.pipeline import FrontEnd
from stereocalib_core.results import FrameResult
from stereocalib_core.sources.synthetic import SyntheticSource

SPEC = (
    "synthetic:straight?frames=34&fault=dirt@2-3&fault=glare@5-6&fault=low_texture@8-9&fault=rain@11-12"
    "&fault=night@14-15&fault=truck@17-18&fault=swap@20&fault=freeze@22-23&fault=drop@25"
    "&fault=rectification:pitch=0.3@27-28&fault=knock:pitch=0.5@30"
)


@pytest.fixture(scope="module")
def drive() -> SyntheticSource:
    return SyntheticSource.from_spec(SPEC)


@pytest.fixture(scope="module")
def results(drive: SyntheticSource) -> list[FrameResult]:
    front_end = FrontEnd(drive.camera, PipelineConfig())
    return [front_end.step(drive[i]) for i in range(len(drive))]


@pytest.mark.parametrize(
    ("frame", "reasons"),
    [
        (8, {"FLAT_TEXTURE", "NOT_PLANAR", "NO_DISPARITY", "NO_ROAD", "TOO_UNCERTAIN"}),
        (17, {"OUT_OF_RANGE", "NO_ROAD", "NOT_PLANAR", "TOO_UNCERTAIN"}),
        (20, {"SWAPPED"}),
        (22, {"FROZEN"}),
        (25, {"MISSING_PAIR"}),
        (27, {"MISALIGNED"}),
    ],
)
def test_a_fault_that_hides_the_road_is_named(
    results: list[FrameResult], frame: int, reasons: set[str]
) -> None:
    assert results[frame].reason in reasons


@pytest.mark.parametrize("frame", [2, 5, 11, 14])
def test_a_spoilt_view_gives_the_truth_or_a_failure(
    drive: SyntheticSource, results: list[FrameResult], frame: int
) -> None:
    result = results[frame]
    if result.road is not None:
        error = result.road.extrinsics.pitch_rad - drive.ground_truth.extrinsics[frame, 1]
        assert abs(np.rad2deg(error)) < 0.3


@pytest.mark.parametrize("frame", [0, 4, 7, 10, 13, 16, 19, 21, 24, 26, 29, 31, 33])
def test_between_the_faults_the_truth_is_found(
    drive: SyntheticSource, results: list[FrameResult], frame: int
) -> None:
    road = results[frame].road
    assert road is not None
    true = drive.ground_truth.extrinsics[frame]
    assert abs(road.extrinsics.height_m - true[0]) < 0.02
    assert abs(np.rad2deg(road.extrinsics.pitch_rad - true[1])) < 0.06
    assert abs(np.rad2deg(road.extrinsics.roll_rad - true[2])) < 0.25
