"""Lists of pictures that are a frame apart: the run says so, and which picture belongs to which."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from stereocalib_core.config import LagConfig, PipelineConfig
from stereocalib_core.errors import Failure, FailureReason
from stereocalib_core.front.rows.lag import lag_of
from stereocalib_core.results import Drive, FrameResult
from stereocalib_core.run.drive import run_drive
from stereocalib_core.run.lag import with_lag
from stereocalib_core.sources import open_source

SIZE = "width=613&height=185&focal_px=353.5&cx_px=300.5&cy_px=91.5"
SPEC = f"synthetic:straight?{SIZE}&frames=24"


def shifted(folder: Path, shift: int, black: bool = False) -> Drive:
    """A run over pairs of left i and right i + shift. black: the right pictures keep nothing to match."""
    source = open_source(SPEC)
    camera = source.camera
    for side in ("left", "right"):
        (folder / side).mkdir(parents=True)
    for i in range(2, 22):
        left, right = source[i].left, source[i + shift].right
        assert left is not None
        assert right is not None
        cv2.imwrite(str(folder / "left" / f"{i:06d}.png"), left)
        cv2.imwrite(str(folder / "right" / f"{i:06d}.png"), right // 12 if black else right)
    (folder / "camera.yaml").write_text(
        f"width: {camera.width}\nheight: {camera.height}\nfocal_px: {camera.focal_px}\ncx_px: {camera.cx_px}\n"
        f"cy_px: {camera.cy_px}\nbaseline_m: {camera.baseline_m}\nfps: 10\n"
    )
    return run_drive(str(folder), folder / "out")


@pytest.mark.parametrize("shift", [-1, 1])
def test_right_pictures_of_another_frame_are_named(tmp_path: Path, shift: int) -> None:
    drive = shifted(tmp_path / "drive", shift)
    (cause,) = drive.causes
    assert cause.reason == "UNSYNCHRONISED"
    assert f"right picture i{-shift:+d}" in cause.remedy
    assert ("earlier" if shift > 0 else "later") in cause.cause
    assert drive.why_not is not None


@pytest.mark.parametrize("black", [False, True])
def test_pictures_of_one_moment_are_not_blamed(tmp_path: Path, black: bool) -> None:
    drive = shifted(tmp_path / "drive", 0, black)
    assert (drive.why_not is not None) == black
    assert "UNSYNCHRONISED" not in [cause.reason for cause in drive.causes]


def test_what_is_not_sure_is_no_lag() -> None:
    own, other = [10.0, 20.0, 60.0, 20.0, 10.0], [10.0, 20.0, 25.0, 60.0, 10.0]
    assert lag_of(np.array([other] * 8), LagConfig()) == 1
    assert lag_of(np.array([own] * 8), LagConfig()) is None
    assert lag_of(np.array([[30.0, 30.0, 29.0, 30.0, 30.0]] * 16), LagConfig()) is None
    assert lag_of(np.array([[0.0, 0.0, 0.0, 900.0, 0.0], *[own] * 5]), LagConfig()) is None
    assert lag_of(np.empty((0, 5)), LagConfig()) is None


def test_a_live_source_is_not_asked_again() -> None:
    """What it gave next would be another moment, or the end of the device."""

    class Ended(list[None]):
        live = True

        def __getitem__(self, index: object) -> None:  # type: ignore[override]
            raise IndexError("the live camera has ended")

    failure = Failure(FailureReason.NO_ROAD, "a truck")
    blind = [FrameResult(frame=i, timestamp_s=0.1 * i, road=None, failure=failure) for i in range(20)]
    drive = Drive.of_frames(blind, PipelineConfig())
    assert with_lag(drive, blind, Ended([None] * 20), PipelineConfig()) is drive  # type: ignore[arg-type]
