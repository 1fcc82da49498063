"""Rigs that are nothing like a car's: the same settings measure a robot's camera, a lorry's, steep and wide ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stereocalib_core.config import PipelineConfig
from stereocalib_core.front.pipeline import FrontEnd
from stereocalib_core.sources.formats.synthetic import SyntheticSource

ROBOT = (640, 480, 500.0, 319.5, 239.5, 0.06)
SHORT = (640, 480, 350.0, 319.5, 239.5, 0.12)
KITTI = (1226, 370, 707.0, 602.0, 183.0, 0.54)
WIDE = (1280, 720, 537.0, 639.5, 359.5, 0.2)
"""100 degrees of view."""
LARGE = (3840, 2160, 2200.0, 1919.5, 1079.5, 0.3)
"""4K."""
NAMES = ("width", "height", "focal_px", "cx_px", "cy_px", "baseline_m")


@pytest.mark.parametrize(
    ("camera", "mount"),
    [
        (ROBOT, "mount_height_m=0.4"),
        (SHORT, "mount_height_m=1.2"),
        (KITTI, "mount_height_m=3.2"),
        (KITTI, "mount_pitch_deg=12"),
        (KITTI, "mount_pitch_deg=30"),
        (WIDE, "mount_height_m=1.65"),
    ],
    ids=["robot", "short baseline", "lorry", "12 deg", "30 deg", "wide"],
)
def test_any_rig_measures_its_plane(tmp_path: Path, camera: tuple[float, ...], mount: str) -> None:
    _measures(tmp_path, "plane", camera, f"{mount}&frames=4")


@pytest.mark.parametrize(
    ("camera", "mount"),
    [
        (KITTI, "mount_pitch_deg=30&frames=2"),
        (LARGE, "mount_height_m=1.5&frames=1"),
    ],
    ids=["30 deg", "4K"],
)
def test_any_rig_measures_a_crowned_road(tmp_path: Path, camera: tuple[float, ...], mount: str) -> None:
    _measures(tmp_path, "straight", camera, mount)


def _measures(folder: Path, course: str, camera: tuple[float, ...], settings: str) -> None:
    file = folder / "camera.yaml"
    file.write_text("".join(f"{name}: {value}\n" for name, value in zip(NAMES, camera, strict=True)))
    source = SyntheticSource.from_spec(f"synthetic:{course}?camera={file}&{settings}")
    assert source.camera.baseline_m == camera[5]
    truth = source.ground_truth.extrinsics
    assert truth is not None
    front_end = FrontEnd(source.camera, PipelineConfig())
    for i in range(len(source)):
        result = front_end.step(source[i])
        assert result.road is not None, result.failure
        e = result.road.extrinsics
        error = np.array([e.height_m, e.pitch_rad, e.roll_rad]) - truth[i, :3]
        assert abs(error[0]) < 0.006 * truth[i, 0]
        assert np.all(np.abs(np.rad2deg(error[1:])) < 0.06)
        assert np.all(np.abs(error) < 4.0 * result.road.sigma)
