"""KITTI's sets of single pairs: each with the calibration and the size that are its own."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from drive_writer import picture, write_picture

from stereocalib_core.config import PipelineConfig
from stereocalib_core.front.pipeline import FrontEnd
from stereocalib_core.sources import SourceKind, open_source, source_kind
from stereocalib_core.sources.formats.synthetic import SyntheticSource


def _calib(focal: float, cx: float, cy: float, baseline: float) -> str:
    rows = [
        f"P{i}: {focal} 0 {cx} {-focal * baseline * (i % 2)} 0 {focal} {cy} 0 0 0 1 0\n" for i in range(4)
    ]
    return "".join(rows)


def test_every_pair_keeps_its_own_camera(tmp_path: Path) -> None:
    folder = tmp_path / "training"
    cameras = [(80.0, 47.5, 31.5, 0.5, 96, 64)] * 3 + [(84.0, 49.0, 30.0, 0.6, 100, 62)]
    for i, (*numbers, width, height) in enumerate(cameras):
        for side, name in (("left", "image_2"), ("right", "image_3")):
            write_picture(folder / name / f"{i:06d}_10.png", picture(i, side, width, height))
        path = folder / "calib" / f"{i:06d}.txt"
        path.parent.mkdir(exist_ok=True)
        path.write_text(_calib(*numbers))
    source = open_source(str(folder))
    assert source_kind(str(folder)) is SourceKind.KITTI_PAIRS
    assert len(source) == 4
    assert [source[i].camera for i in range(3)] == [None, None, None]
    own = source[3].camera
    assert own is not None
    assert (own.focal_px, own.cx_px, own.width, own.height, own.baseline_m) == (84.0, 49.0, 100, 62, 0.6)
    assert source[3].left is not None and source[3].left.shape == (62, 100)
    assert any("2 different calibrations" in note for note in source.notices)


def test_a_damaged_calibration_fails_its_pair_alone(tmp_path: Path) -> None:
    folder = tmp_path / "training"
    for i in range(3):
        for side, name in (("left", "image_2"), ("right", "image_3")):
            write_picture(folder / name / f"{i:06d}.png", picture(i, side))
        path = folder / "calib" / f"{i:06d}.txt"
        path.parent.mkdir(exist_ok=True)
        path.write_text(_calib(80.0, 47.5, 31.5, 0.5) if i != 1 else "P2: nan\n")
    source = open_source(str(folder))
    assert [source[i].failure is None for i in range(3)] == [True, False, True]


def test_a_pair_with_another_camera_is_measured_with_it(tmp_path: Path) -> None:
    """The same scene seen at 0.8 of the size: the same height and angles, which the drive's own camera would miss."""
    scene = SyntheticSource.from_spec("synthetic:plane?frames=1")
    frame, camera = scene[0], scene.camera
    assert frame.left is not None and frame.right is not None
    folder = tmp_path / "training"
    size = (round(camera.width * 0.8), round(camera.height * 0.8))
    sx, sy = size[0] / camera.width, size[1] / camera.height
    for i in range(3):
        small = i == 2
        for image, name in ((frame.left, "image_2"), (frame.right, "image_3")):
            write_picture(
                folder / name / f"{i:06d}.png",
                cv2.resize(image, size, interpolation=cv2.INTER_AREA) if small else image,
            )
        focal, cx, cy = camera.focal_px, camera.cx_px, camera.cy_px
        if small:
            focal, cx, cy = focal * sx, (cx + 0.5) * sx - 0.5, (cy + 0.5) * sy - 0.5
        path = folder / "calib" / f"{i:06d}.txt"
        path.parent.mkdir(exist_ok=True)
        path.write_text(_calib(focal, cx, cy, camera.baseline_m))
    assert abs(sx - sy) < 2e-3
    source = open_source(str(folder))
    front_end = FrontEnd(source.camera, PipelineConfig())
    results = [front_end.step(source[i]) for i in range(3)]
    heights = [r.road.extrinsics.height_m for r in results if r.road is not None]
    pitches = [np.rad2deg(r.road.extrinsics.pitch_rad) for r in results if r.road is not None]
    assert len(heights) == 3
    assert abs(heights[2] - heights[0]) < 0.01
    assert abs(pitches[2] - pitches[0]) < 0.03
