"""Twenty real poses, a fisheye camera and a VLP-16; the reference is another tool's, so a consistency check."""

from __future__ import annotations

import json
import shutil
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stereocalib_core.boards import Calibration, Detection, calibrate, detect, open_folder, ticked_mask
from stereocalib_core.boards.chessboard import posed_again
from stereocalib_core.boards.intrinsics import estimate_camera
from stereocalib_core.boards.rotations import rotation_angle, rotation_from_roll_pitch_yaw, rotation_vector
from stereocalib_core.geometry import invert_transform, transform
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.run.boards import run


@pytest.fixture(scope="module")
def folder(data_dir: Path) -> Path:
    return data_dir / "boards_vlp16"


@pytest.fixture(scope="module")
def found(folder: Path) -> Detection:
    return detect(open_folder(folder))


@pytest.fixture(scope="module")
def reference(folder: Path) -> Array:
    """T_lidar_camera: the component-wise median of the other tool's fifty solutions."""
    rows = np.genfromtxt(folder / "reference_lidar_from_camera.csv", delimiter=",", skip_header=1)
    middle = np.median(rows, axis=0)
    return transform(rotation_from_roll_pitch_yaw(*middle[:3]), middle[3:])


def difference(a: Array, b: Array) -> tuple[float, float]:
    return float(np.rad2deg(rotation_angle(a[:3, :3].T @ b[:3, :3]))), float(
        np.linalg.norm(a[:3, 3] - b[:3, 3])
    )


def test_whole_clouds_against_the_reference(found: Detection, reference: Array) -> None:
    result = calibrate(found.observations, found.board, found.camera)
    assert sum(p.ok for p in result.pairs) >= 18
    turn_deg, shift_m = difference(result.T_lidar_camera, reference)
    assert turn_deg < 0.7
    assert shift_m < 0.040
    assert result.verdict == "good"
    assert result.held_out.plane_rms_m < 0.025


def test_two_halves_agree(found: Detection) -> None:
    names = [o.name for o in found.observations]
    halves = [
        calibrate(
            found.observations, found.board, found.camera, ticked_mask(found.observations, names[start::2])
        )
        for start in (0, 1)
    ]
    turn_deg, shift_m = difference(halves[0].T_lidar_camera, halves[1].T_lidar_camera)
    assert turn_deg < 0.6
    assert shift_m < 0.020
    assert np.all(np.abs(gap(*halves)) < 2.0)


def gap(a: Calibration, b: Calibration) -> Array:
    """(6,) how far two results part, in their joint sigma."""
    turn = rotation_vector(a.T_camera_lidar[:3, :3] @ b.T_camera_lidar[:3, :3].T)
    parted = np.concatenate([turn, a.T_camera_lidar[:3, 3] - b.T_camera_lidar[:3, 3]])
    return parted / np.sqrt(np.diag(a.covariance) + np.diag(b.covariance))


@pytest.mark.parametrize("square_m", [0.100, 0.097])
def test_a_wrong_square_is_measured(found: Detection, square_m: float, reference: Array) -> None:
    board = replace(found.board, square_m=square_m)
    observations = [posed_again(o, found.camera, board) for o in found.observations]
    result = calibrate(observations, board, found.camera)
    assert result.scale.doubted
    assert square_m * result.scale.value == pytest.approx(0.095, abs=0.0005)
    assert difference(result.T_lidar_camera, reference)[1] < 0.040


def test_an_estimated_camera_agrees_within_its_sigma(found: Detection) -> None:
    corners = [o.corners for o in found.observations if o.corners is not None]
    camera, rms = estimate_camera(corners, (found.camera.width, found.camera.height), found.board)
    assert camera.model == "fisheye"
    assert rms < 0.15
    observations = [posed_again(o, camera, found.board) for o in found.observations]
    estimated = calibrate(observations, found.board, camera, with_intrinsics=True)
    known = calibrate(found.observations, found.board, found.camera)
    assert np.all(np.abs(gap(estimated, known)) < 2.0)


def test_ticking_a_pair_out_is_quick(found: Detection) -> None:
    """A page that answers at once: a tenth of this limit is what it takes."""
    times = []
    for o in found.observations[:6]:
        start = time.thread_time()
        calibrate(found.observations, found.board, found.camera, ticked_mask(found.observations, [o.name]))
        times.append(time.thread_time() - start)
    assert np.median(times) < 1.0


def test_cropped_clouds_give_the_same(folder: Path, found: Detection) -> None:
    whole = calibrate(found.observations, found.board, found.camera)
    cropped = detect(open_folder(folder, cropped=True))
    result = calibrate(cropped.observations, cropped.board, cropped.camera)
    assert sum(p.ok for p in result.pairs) >= 18
    turn_deg, shift_m = difference(whole.T_lidar_camera, result.T_lidar_camera)
    assert turn_deg < 0.3
    assert shift_m < 0.012


def test_swapped_clouds_are_named_from_the_files(folder: Path, reference: Array, tmp_path: Path) -> None:
    names = [f"pose{i:02d}" for i in (1, 3, 7, 9, 13, 21, 27, 29)]
    mixed = tmp_path / "mixed"
    for part in ("images", "clouds"):
        (mixed / part).mkdir(parents=True)
    for name in ("camera.yaml", "board.yaml"):
        shutil.copy(folder / name, mixed)
    swap = {"pose07": "pose21", "pose21": "pose07"}
    for name in names:
        (mixed / "images" / f"{name}.png").symlink_to(folder / "images" / f"{name}.png")
        (mixed / "clouds" / f"{name}.pcd").symlink_to(folder / "clouds" / f"{swap.get(name, name)}.pcd")
    out = tmp_path / "out"
    out.mkdir()
    result = run(mixed, out).calibration
    refused = {p.name: p.reason for p in result.pairs if not p.ok}
    assert set(refused) == {"pose07", "pose21"}
    assert "wrong pair" in refused["pose07"]
    assert "pose21" in refused["pose07"]
    turn_deg, shift_m = difference(result.T_lidar_camera, reference)
    assert turn_deg < 0.9
    assert shift_m < 0.050
    written = json.loads((out / "calibration.json").read_text())
    T = np.array(written["T_camera_lidar"])
    np.testing.assert_allclose(invert_transform(T), np.array(written["T_lidar_camera"]), atol=1e-12)
    assert {p.name for p in out.glob("overlay_*.png")} == {f"overlay_{n}.png" for n in names}
