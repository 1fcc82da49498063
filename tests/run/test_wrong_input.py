"""Recordings that belong to another calibration, or stand on their head: what is wrong is named, with what to do."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereocalib_core.config import PipelineConfig
from stereocalib_core.frames import FrameSource
from stereocalib_core.front.road.estimate import estimate_road
from stereocalib_core.results import Drive
from stereocalib_core.run.drive import run_drive
from stereocalib_core.sources import open_source

SIZE = "width=613&height=185&focal_px=353.5&cx_px=300.5&cy_px=91.5"
Grey = np.ndarray
Change = Callable[[Grey], Grey]


@pytest.fixture(scope="module")
def rendered() -> FrameSource:
    return open_source(f"synthetic:straight?{SIZE}&frames=60")


def run(
    rendered: FrameSource, folder: Path, change: Change, frames: range = range(8), cx_px: float | None = None
) -> Drive:
    """A run over these frames of a rendered street, `change` made to every picture."""
    camera = rendered.camera
    size = (camera.width, camera.height)
    for side in ("left", "right"):
        (folder / side).mkdir(parents=True)
    for k, i in enumerate(frames):
        frame = rendered[i]
        for side, picture in (("left", frame.left), ("right", frame.right)):
            assert picture is not None
            changed = change(picture)
            size = changed.shape[::-1]
            cv2.imwrite(str(folder / side / f"{k:06d}.png"), changed)
    (folder / "camera.yaml").write_text(
        f"width: {size[0]}\nheight: {size[1]}\nfocal_px: {camera.focal_px}\n"
        f"cx_px: {camera.cx_px if cx_px is None else cx_px}\ncy_px: {camera.cy_px}\n"
        f"baseline_m: {camera.baseline_m}\nfps: 10\n"
    )
    return run_drive(str(folder), folder / "out")


@pytest.mark.parametrize(
    ("change", "reason", "remedy"),
    [
        (
            lambda picture: picture[::-1, ::-1],
            "SWAPPED",
            "turn both pictures by half a turn; left and right stay",
        ),
        (lambda picture: picture[::-1], "NO_ROAD", "by half a turn and exchange left and right; flip them"),
        (lambda picture: picture[:, ::-1], "SWAPPED", "exchange the two folders"),
    ],
    ids=["turned by half", "top to bottom", "mirrored"],
)
def test_pictures_on_their_head_are_told_from_swapped_ones(
    rendered: FrameSource, tmp_path: Path, change: Change, reason: str, remedy: str
) -> None:
    drive = run(rendered, tmp_path / "drive", change)
    assert drive.frames_ok == 0
    (cause,) = drive.causes
    assert (cause.reason, cause.first, cause.last) == (reason, 0, 7)
    assert ("upside down" in cause.cause) == (remedy[:4] in ("turn", "by h"))
    assert remedy in cause.remedy


def test_a_principal_point_of_other_pictures_shows_as_a_yaw_that_no_mount_has(
    rendered: FrameSource, tmp_path: Path
) -> None:
    """Cut at the right, with the size put right and the rest not: 16 deg beside where the car goes."""
    drive = run(rendered, tmp_path / "drive", lambda picture: picture, range(26), cx_px=400.5)
    cause = drive.causes[0]
    assert cause.reason == "CALIBRATION"
    assert "deg beside where the car goes" in cause.cause
    assert drive.why_not is not None and "do not belong together" in drive.why_not


def test_steps_too_long_for_tracks_are_a_gap_and_no_standstill(rendered: FrameSource, tmp_path: Path) -> None:
    drive = run(rendered, tmp_path / "drive", lambda picture: picture, range(0, 60, 12))
    assert drive.frames_ok == 5
    path = drive.paths["autocalibrated"]
    assert path.errors.path_m is None or path.errors.path_m > 30.0, "the car stood still, it says"
    if path.errors.path_m is None:
        assert drive.why_not is not None and "a gap" in drive.why_not


def test_pictures_larger_than_those_of_a_car_are_usable(kitti_06: Path) -> None:
    """2.5 times as large, with the calibration that goes with them."""
    source = open_source(str(kitti_06))
    frame, camera, times = source[0], source.camera, 2.5
    left, right = (
        cv2.resize(picture, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC)
        for picture in (frame.left, frame.right)
    )
    own = estimate_road(frame.left, frame.right, camera, PipelineConfig()).estimate
    large = type(camera)(
        left.shape[1], left.shape[0], camera.focal_px * times, (camera.cx_px + 0.5) * times - 0.5,
        (camera.cy_px + 0.5) * times - 0.5, camera.baseline_m,
    )  # fmt: skip
    found = estimate_road(left, right, large, PipelineConfig())
    assert own is not None and found.estimate is not None, found.failure
    a, b = found.estimate.extrinsics, own.extrinsics
    assert abs(a.height_m - b.height_m) < 0.02
    assert abs(a.pitch_deg - b.pitch_deg) < 0.1
    assert abs(a.roll_deg - b.roll_deg) < 0.25


def test_a_pair_that_hardly_a_frame_shows_is_not_suspected(rendered: FrameSource, tmp_path: Path) -> None:
    drive = run(rendered, tmp_path / "drive", lambda picture: picture, range(2))
    assert drive.frames_ok == 2 and drive.why_not is None
    assert drive.pair.verdict == "not measured"
    assert "only 2 of 2 frames could be matched" in drive.pair.why
