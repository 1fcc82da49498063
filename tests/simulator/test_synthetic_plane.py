"""The flat plane and the plane drive: disparity against eq. 16, pictures against the disparity."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.simulator.plane import render_plane, render_plane_truth, right_rotation
from stereocalib_core.sources.formats.synthetic import SyntheticSource

CAMERA = StereoCamera(640, 240, 400.0, 318.7, 110.3, 0.54)
QUIET = "noise=0&exposure_difference=0&vignetting=0&motion_blur=0"


def grid(camera: StereoCamera) -> tuple[np.ndarray, np.ndarray]:
    u, v = np.meshgrid(np.arange(camera.width, dtype=np.float64), np.arange(camera.height, dtype=np.float64))
    return u, v


def warp_right(right: np.ndarray, disparity: np.ndarray) -> np.ndarray:
    h, w = right.shape
    u, v = np.meshgrid(np.arange(w, dtype=np.float32), np.arange(h, dtype=np.float32))
    return cv2.remap(right.astype(np.float32), u - np.nan_to_num(disparity), v, cv2.INTER_CUBIC)


@pytest.mark.parametrize("angles", [(1.65, 0.8, -0.4), (1.2, -2.0, 4.0), (2.4, 6.0, -5.0)])
def test_plane_obeys_eq_16_and_its_pictures_obey_the_plane(angles: tuple[float, float, float]) -> None:
    extrinsics = Extrinsics.from_degrees(*angles)
    left, right, disparity = render_plane_truth(CAMERA, extrinsics, seed=3, noise=0.0)
    u, v = grid(CAMERA)
    expected = extrinsics.disparity_plane(CAMERA).disparity(CAMERA, u, v)
    road = np.isfinite(disparity)
    assert np.abs(disparity - expected)[road].max() < 1e-4
    near = road & (disparity > 4) & (u - np.nan_to_num(disparity) > 3)
    error = warp_right(right, disparity)[near] - left[near]
    assert np.median(np.abs(error)) < 1.0
    assert error.std() < 0.15 * left[near].std()
    # half a pixel off must be seen by this test
    shifted = warp_right(right, disparity + np.float32(0.5))[near] - left[near]
    assert shifted.std() > 1.7 * error.std()


def test_render_plane_options() -> None:
    extrinsics = Extrinsics.from_degrees(1.65, 0.8, -0.4)
    left, right = render_plane(CAMERA, extrinsics, seed=1)
    again, _ = render_plane(CAMERA, extrinsics, seed=1)
    other, _ = render_plane(CAMERA, extrinsics, seed=2)
    assert left.dtype == np.uint8 and left.shape == (240, 640)
    assert np.array_equal(left, again) and not np.array_equal(left, other)
    _, bright = render_plane(CAMERA, extrinsics, seed=1, exposure_difference=0.1, noise=0.0)
    _, plain = render_plane(CAMERA, extrinsics, seed=1, noise=0.0)
    assert bright[200].mean() / plain[200].mean() == pytest.approx(1.1, abs=0.01)
    cluttered, _, disparity = render_plane_truth(CAMERA, extrinsics, seed=1, clutter=True)
    u, v = grid(CAMERA)
    plane = extrinsics.disparity_plane(CAMERA).disparity(CAMERA, u, v)
    below = v > 150
    covered = (np.abs(np.nan_to_num(disparity) - plane) > 0.5) & below
    assert 0.15 < covered.sum() / below.sum() < 0.8


def test_turned_right_camera_moves_rows_as_said() -> None:
    extrinsics = Extrinsics.from_degrees(1.65, 0.8, -0.4)
    _, straight = render_plane(CAMERA, extrinsics, seed=1, noise=0.0)
    _, turned = render_plane(
        CAMERA, extrinsics, seed=1, noise=0.0, R_left_right=right_rotation(pitch_deg=0.2)
    )
    # looking down by 0.2 degrees lifts the picture by f tan(0.2 deg) rows
    rows = CAMERA.focal_px * np.tan(np.deg2rad(0.2))
    u, v = np.meshgrid(np.arange(640, dtype=np.float32), np.arange(240, dtype=np.float32))
    lifted = cv2.remap(straight.astype(np.float32), u, v + np.float32(rows), cv2.INTER_CUBIC)
    part = np.s_[150:230, 50:590]
    assert (
        np.abs(lifted[part] - turned[part]).mean()
        < 0.3 * np.abs(straight[part].astype(float) - turned[part]).mean()
    )


def test_plane_drive_satisfies_eq_16_to_a_hundredth_of_a_pixel() -> None:
    source = SyntheticSource.from_spec(f"synthetic:plane?frames=12&{QUIET}")
    u, v = grid(source.camera)
    truth = source.ground_truth.extrinsics
    assert truth is not None
    for i in (0, 11):
        extrinsics = Extrinsics(*truth[i])
        expected = extrinsics.disparity_plane(source.camera).disparity(source.camera, u, v)
        seen = source.truth(i)
        road = seen.labels == 1
        assert road.mean() > 0.45
        assert np.abs(seen.disparity - expected)[road].max() < 0.01
        left, right = source.studio.pictures(i)
        part = road & (expected > 5) & (u - expected > 3)
        error = warp_right(right, seen.disparity)[part] - left[part]
        assert np.median(np.abs(error)) < 1.0 and error.std() < 0.15 * left[part].std()


def test_plane_drive_keeps_the_mount_without_body_motion() -> None:
    mount = "mount_height_m=1.4&mount_pitch_deg=2&mount_roll_deg=1&mount_yaw_deg=-1"
    truth = SyntheticSource.from_spec(
        f"synthetic:plane?frames=30&body_motion=0&{mount}"
    ).ground_truth.extrinsics
    expected = [1.4, *np.deg2rad([2.0, 1.0, -1.0])]
    assert np.abs(truth - expected).max() < 1e-9
