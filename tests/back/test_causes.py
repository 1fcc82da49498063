"""Why frames failed: the leading cause with both its numbers, from made-up frames and from a rendered drive."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stereocalib_core.back.causes import calibration_of_others, find_causes
from stereocalib_core.back.remedies import REMEDIES
from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import Failure, FailureReason
from stereocalib_core.files.run_folder import load_run
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.results import Check, DepthScale, FrameResult, RoadEstimate
from stereocalib_core.run.drive import run_drive

STAGES = {
    "mean grey": ("image", 70.0),
    "saturated share": ("image", 0.01),
    "texture": ("image", 4.0),
    "left-right matches": ("rectification", 70.0),
    "valid share, lower half": ("disparity", 0.9),
    "patches on the plane": ("direct", 0.98),
    "near road over the plane, rms": ("direct", 8.0),
}
NOT_PLANAR, NO_ROAD, FLAT = FailureReason.NOT_PLANAR, FailureReason.NO_ROAD, FailureReason.FLAT_TEXTURE


def frame(number: int, reason: FailureReason | None = None, **numbers: float) -> FrameResult:
    """A frame with the usual numbers within a few percent, but for those given (words joined by underscores)."""
    rng = np.random.default_rng(number)
    given = {name.replace("_", " "): value for name, value in numbers.items()}
    checks = tuple(
        Check(stage, name, given.get(name, usual * (1.0 + 0.03 * rng.standard_normal())))
        for name, (stage, usual) in STAGES.items()
    )
    if reason is not None:
        return FrameResult(number, 0.1 * number, None, Failure(reason, "so and so"), checks=checks)
    road = RoadEstimate(Extrinsics(1.65, 0.01, 0.0), np.eye(3) * 1e-6, 100, 0.5, (4, 20))
    return FrameResult(number, 0.1 * number, road, checks=checks)


def night(number: int, reason: FailureReason = NOT_PLANAR) -> FrameResult:
    return frame(number, reason, mean_grey=15.0, **{"left-right_matches": 12.0})


def test_darkness_leads_with_both_numbers_before_what_came_of_it() -> None:
    drive = [night(i) if 10 <= i <= 14 else frame(i) for i in range(40)]
    (cause,) = find_causes(drive)
    assert (cause.first, cause.last, cause.reason) == (10, 14, "NOT_PLANAR")
    assert cause.cause.startswith("too dark: grey 15 instead of ")
    assert abs(float(cause.cause.split("instead of ")[1].split(",")[0]) - 70.0) <= 2.0
    assert "12 matches instead of 7" in cause.cause or "12 matches instead of 6" in cause.cause
    assert "kerb" not in cause.cause
    assert "exposure" in cause.remedy


def test_one_span_per_run_of_one_reason() -> None:
    drive = [frame(i) for i in range(20)]
    drive[4:6] = [night(4), night(5)]
    drive[6] = night(6, NO_ROAD)
    drive[9] = frame(9, FailureReason.MISSING_PAIR)
    found = [(c.first, c.last, c.reason) for c in find_causes(drive)]
    assert found == [(4, 5, "NOT_PLANAR"), (6, 6, "NO_ROAD"), (9, 9, "MISSING_PAIR")]


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ({"saturated_share": 0.4}, "too bright: glare or over-exposure: 40% white instead of 1%"),
        ({"texture": 0.9}, "the picture has lost its texture"),
        ({"left-right_matches": 20.0}, "left and right have little in common"),
        ({"valid_share,_lower_half": 0.3}, "left and right have little in common"),
    ],
)
def test_what_left_the_usual_is_the_cause(numbers: dict[str, float], words: str) -> None:
    drive = [frame(i, NO_ROAD, **numbers) if i == 12 else frame(i) for i in range(30)]
    (cause,) = find_causes(drive)
    assert cause.cause.startswith(words)


def test_more_sigmas_lead_within_one_step() -> None:
    def mixed(share: float) -> str:
        numbers = {"left-right_matches": 30.0, "valid_share,_lower_half": share}
        return find_causes([frame(i, NO_ROAD, **numbers) if i == 12 else frame(i) for i in range(30)])[
            0
        ].cause

    assert mixed(0.05).index("lower half") < mixed(0.05).index("matches instead")
    assert mixed(0.44).index("matches instead") < mixed(0.44).index("lower half")


def test_an_ordinary_change_is_told_but_blames_nothing() -> None:
    drive = [frame(i, NOT_PLANAR, mean_grey=42.0) if i == 12 else frame(i) for i in range(30)]
    (cause,) = find_causes(drive)
    own, remedy = REMEDIES[NOT_PLANAR]
    assert cause.cause.startswith(f"{own} (so and so")
    assert cause.remedy == remedy
    rough = {"near_road_over_the_plane,_rms": 60.0}
    (cause,) = find_causes([frame(i, NOT_PLANAR, **rough) if i == 12 else frame(i) for i in range(30)])
    assert cause.cause.startswith(own)
    assert "near road 60 mm rms off its plane instead of 8" in cause.cause


def test_a_scattered_drive_needs_more() -> None:
    """Grey that swings between good frames by itself says nothing."""
    greys = np.random.default_rng(0).uniform(10.0, 130.0, 40)
    drive = [frame(i, mean_grey=float(g)) for i, g in enumerate(greys)]
    drive[20] = frame(20, NO_ROAD, mean_grey=15.0)
    assert "too dark" not in find_causes(drive)[0].cause


def test_a_cable_is_not_blamed_on_the_night() -> None:
    drive = [night(i, FailureReason.FROZEN) if i == 12 else frame(i) for i in range(30)]
    assert find_causes(drive)[0].cause.startswith(REMEDIES[FailureReason.FROZEN][0])


def test_good_frames_around_in_the_dark_are_told() -> None:
    drive = [frame(i) for i in range(60)]
    for i in range(30, 41):
        drive[i] = frame(i, mean_grey=16.0)
    drive[35] = night(35)
    assert "(in the good frames around it 16)" in find_causes(drive)[0].cause
    assert "around" not in find_causes([*drive[:30], night(30), *drive[41:]])[0].cause


def test_without_good_frames_the_reason_speaks() -> None:
    (cause,) = find_causes([night(i) for i in range(9)])
    assert cause.cause == f"{REMEDIES[NOT_PLANAR][0]} (so and so)"
    few = [night(i) if i > 3 else frame(i) for i in range(9)]
    assert find_causes(few)[0].cause == cause.cause
    assert find_causes([frame(4), *few])[0].cause.startswith("too dark")
    assert find_causes([frame(i) for i in range(9)]) == ()
    assert find_causes([]) == ()


def test_of_a_rendered_drive(tmp_path: Path) -> None:
    """At half size the road is lost at night, and with both numbers of the drive's own pictures."""
    size = "width=613&height=185&focal_px=353.5&cx_px=300.5&cy_px=91.5"
    run_drive(f"synthetic:straight?{size}&frames=16&fault=night@8-9&fault=drop@12", tmp_path)
    dark, dropped = load_run(tmp_path).causes
    assert (dark.first, dark.last, dropped.first, dropped.reason) == (8, 9, 12, "MISSING_PAIR")
    assert dark.cause.startswith("too dark: grey 1")
    assert "matches instead of" in dark.cause


def test_where_no_frame_is_good_a_number_near_its_limit_tells() -> None:
    def poor(number: int, texture: float) -> FrameResult:
        checks = (Check("image", "mean grey", 140.0, low=10.0), Check("image", "texture", texture, low=0.8))
        return FrameResult(number, 0.1 * number, None, Failure(NO_ROAD, "so and so"), checks=checks)

    (fog,) = find_causes([poor(i, 0.9) for i in range(12)])
    assert (
        fog.cause.startswith("the picture has lost its texture: fog")
        and "0.9, where 0.8 is the least" in fog.cause
    )
    assert "clean the lens" in fog.remedy
    (blocked,) = find_causes([poor(i, 4.0) for i in range(12)])
    assert blocked.cause.startswith(REMEDIES[NO_ROAD][0])


def test_lenses_with_drops_where_no_frame_is_good() -> None:
    def wet(number: int) -> FrameResult:
        checks = (
            Check("image", "texture", 1.7, low=0.8),
            Check("rectification", "left-right matches", 7, low=12),
        )
        return FrameResult(number, 0.1 * number, None, Failure(NO_ROAD, "so and so"), checks=checks)

    (cause,) = find_causes([wet(i) for i in range(12)])
    assert cause.cause.startswith("left and right have little in common: dirt or drops on a lens")
    assert "left-right matches 7, where 12 is the least" in cause.cause


@pytest.mark.parametrize(
    ("scale", "sigma", "said"),
    [(0.47, 0.002, True), (2.0, 0.01, True), (1.03, 0.002, False), (0.8, 0.06, False)],
    ids=["squeezed", "half the focal length", "a usual calibration", "not sure"],
)
def test_depths_that_are_another_multiple_are_a_calibration_of_others(
    scale: float, sigma: float, said: bool
) -> None:
    config, drive = PipelineConfig(), [frame(i) for i in range(9)]
    found = calibration_of_others(None, DepthScale(scale, sigma, "truth"), drive, config.yaw, config.causes)
    assert bool(found) is said
    if found:
        assert (found[0].reason, found[0].first, found[0].last) == ("CALIBRATION", 0, 8)
        assert f"true depths are {scale:.2f} times what is measured" in found[0].cause
