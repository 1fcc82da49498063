"""The pair's self-check against pairs whose right camera was turned by a known angle."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereocalib_core.back.rig.pair import summarise
from stereocalib_core.config import RectificationConfig
from stereocalib_core.errors import FailureReason
from stereocalib_core.front.rows.self_check import examine, fit_rows
from stereocalib_core.geometry import StereoCamera, rotation_x, rotation_z
from stereocalib_core.results import FrameResult, RectificationSample
from stereocalib_core.sources.formats.synthetic import SyntheticSource

CAMERA = StereoCamera(620, 240, 400.0, 309.0, 118.0, 0.54)
LOW, HIGH = 0.75, 1.5
"""Rms of errors over sigma."""


def textured_pair(seed: int, pitch_rad: float = 0.0, roll_rad: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """A textured plane that leans back, seen by a right camera that is turned against the left one."""
    rng = np.random.default_rng(seed)
    texture = cv2.resize(
        rng.uniform(0, 255, (150, 420)).astype(np.float32), (1260, 450), interpolation=cv2.INTER_CUBIC
    )
    texture = cv2.GaussianBlur(texture, (0, 0), 1.0)
    u, v = np.meshgrid(np.arange(CAMERA.width, dtype=np.float64), np.arange(CAMERA.height, dtype=np.float64))
    left = cv2.remap(texture, (u + 300).astype(np.float32), (v + 100).astype(np.float32), cv2.INTER_CUBIC)
    # A pixel of the turned right camera back to the aligned one, then by disparity 20 + 0.1 v to the left.
    rotation = rotation_x(pitch_rad) @ rotation_z(roll_rad)
    rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ (CAMERA.K @ rotation.T @ CAMERA.K_inv).T
    ua, va = rays[..., 0] / rays[..., 2], rays[..., 1] / rays[..., 2]
    source_u = ua + 20.0 + 0.1 * va + 300
    right = cv2.remap(texture, source_u.astype(np.float32), (va + 100).astype(np.float32), cv2.INTER_CUBIC)
    noise = rng.normal(0, 2.0, (2, CAMERA.height, CAMERA.width))
    to_bytes = [
        np.clip(image + n, 0, 255).astype(np.uint8)
        for image, n in zip((left, 0.9 * right + 8), noise, strict=True)
    ]
    return to_bytes[0], to_bytes[1]


def drive(pairs: list[tuple[np.ndarray, np.ndarray]], camera: StereoCamera = CAMERA) -> list[FrameResult]:
    found = [examine(camera, left, right) for left, right in pairs]
    return [FrameResult(i, 0.1 * i, None, e.failure, rectification=e.sample) for i, e in enumerate(found)]


@pytest.mark.parametrize(("pitch_deg", "roll_deg"), [(0.0, 0.0), (0.05, 0.0), (0.0, 0.1), (-0.08, -0.2)])
def test_a_turned_right_camera_is_measured(pitch_deg: float, roll_deg: float) -> None:
    pairs = [textured_pair(seed, np.deg2rad(pitch_deg), np.deg2rad(roll_deg)) for seed in range(6)]
    report = summarise(CAMERA, drive(pairs))
    assert report.row_offset_px and report.relative_pitch_rad and report.relative_roll_rad
    assert np.rad2deg(report.relative_pitch_rad.value) == pytest.approx(pitch_deg, abs=0.005)
    assert np.rad2deg(report.relative_roll_rad.value) == pytest.approx(roll_deg, abs=0.01)
    assert report.row_offset_px.value == pytest.approx(
        -CAMERA.focal_px * np.tan(report.relative_pitch_rad.value), abs=1e-3
    )
    assert report.verdict == ("good" if pitch_deg == roll_deg == 0.0 else "suspect")


def test_large_turns_fail_the_frame_with_their_numbers() -> None:
    for pitch_deg, roll_deg in ((1.5, 0.0), (0.0, 1.0)):
        found = examine(CAMERA, *textured_pair(1, np.deg2rad(pitch_deg), np.deg2rad(roll_deg)))
        assert found.failure is not None
        assert found.failure.reason is FailureReason.MISALIGNED
        assert found.sample is not None
        np.testing.assert_allclose(np.rad2deg(found.sample.values[1:]), [pitch_deg, roll_deg], atol=0.03)
        assert f"relative pitch {np.rad2deg(found.sample.values[1]):+.3f} deg" in found.failure.detail


def test_swapped_cameras_are_named() -> None:
    results = drive([textured_pair(seed)[::-1] for seed in range(4)])
    assert {r.failure.reason for r in results if r.failure} == {FailureReason.SWAPPED}
    report = summarise(CAMERA, results)
    assert report.verdict == "bad"
    assert "swapped" in report.why
    assert report.relative_pitch_rad is None


def test_what_is_far_away_does_not_hide_that_pictures_are_swapped() -> None:
    source = SyntheticSource.from_spec("synthetic:plane?frames=9&fault=swap@0-8")
    for i in (0, 4, 8):
        frame = source[i]
        assert frame.left is not None and frame.right is not None
        swapped = examine(source.camera, frame.left, frame.right).failure
        assert swapped is not None and swapped.reason is FailureReason.SWAPPED
        assert examine(source.camera, frame.right, frame.left).failure is None


def test_sigma_of_a_frame_is_its_scatter() -> None:
    """Matches whose errors are alike in fours, as `fit_rows` takes them: neither half of its sigma, nor twice."""
    rng = np.random.default_rng(6)
    z = []
    for _ in range(150):
        u, v = np.repeat(rng.uniform([0, 100], [CAMERA.width, CAMERA.height], (75, 2)), 4, axis=0).T
        dv = np.repeat(rng.normal(0, 0.1, 75), 4)
        found = fit_rows(CAMERA, np.stack([u + 20, v, u, v + dv], axis=1), RectificationConfig())
        assert found is not None
        z.append(found.values / np.sqrt(np.diag(found.covariance)))
    rms = np.sqrt(np.mean(np.square(z), axis=0))
    assert (rms > LOW).all() and (rms < HIGH).all(), rms


def test_sigma_of_a_drive_is_its_scatter() -> None:
    """Frames whose errors are alike in fours, as `robust_mean` takes them: the error of the whole is as it says."""
    rng = np.random.default_rng(8)
    sigma = np.array([0.02, np.deg2rad(0.004), np.deg2rad(0.008)])
    z = []
    for _ in range(300):
        errors = np.repeat(rng.standard_normal((15, 3)), 4, axis=0) * sigma
        sample = RectificationSample(np.zeros(3), np.diag(sigma**2), 80)
        results = [
            FrameResult(i, 0.1 * i, None, rectification=dataclasses.replace(sample, values=row))
            for i, row in enumerate(errors)
        ]
        pair = summarise(CAMERA, results)
        for measured in (pair.row_offset_px, pair.relative_pitch_rad, pair.relative_roll_rad):
            assert measured is not None
            z.append(measured.value / measured.sigma)
    rms = np.sqrt(np.mean(np.square(z)))
    assert LOW < rms < HIGH, rms


def test_a_change_within_the_drive_is_reported_with_its_frames() -> None:
    clean, turned = examine(CAMERA, *textured_pair(0)), examine(CAMERA, *textured_pair(0, np.deg2rad(0.08)))
    assert clean.sample and turned.sample
    rng = np.random.default_rng(3)
    results = []
    for i in range(100):
        base = turned.sample if 40 <= i < 70 else clean.sample
        values = base.values + rng.normal(0, 1, 3) * np.sqrt(np.diag(base.covariance))
        results.append(FrameResult(i, 0.1 * i, None, rectification=dataclasses.replace(base, values=values)))
    report = summarise(CAMERA, results)
    assert (report.first, report.last) == (40, 69)
    assert report.row_offset_px and report.relative_pitch_rad and report.relative_roll_rad
    assert np.rad2deg(report.relative_pitch_rad.value) == pytest.approx(0.08, abs=0.008)


def test_the_keystone_is_not_taken_for_roll() -> None:
    rng = np.random.default_rng(4)
    u, v = rng.uniform(0, CAMERA.width, 300), rng.uniform(100, CAMERA.height, 300)
    k = np.deg2rad(0.5)
    dv = k * (u - CAMERA.cx_px) * (v - CAMERA.cy_px) / CAMERA.focal_px + rng.normal(0, 0.05, 300)
    found = fit_rows(CAMERA, np.stack([u + 20, v, u, v + dv], axis=1), RectificationConfig())
    assert found is not None
    assert abs(np.rad2deg(found.values[2])) < 0.01
    assert np.rad2deg(found.keystone_rad) == pytest.approx(0.5, abs=0.06)


def test_nothing_to_match_says_nothing() -> None:
    grey = np.full((240, 620), 90, np.uint8)
    found = examine(CAMERA, grey, grey)
    assert found.sample is None
    assert found.failure is None
    assert summarise(CAMERA, drive([(grey, grey)] * 5)).verdict == "suspect"


@pytest.mark.parametrize("name", ["kitti_06", "kitti_03", "kitti_raw_0009"])
def test_real_drives_read_good(name: str, request: pytest.FixtureRequest) -> None:
    folder: Path = request.getfixturevalue(name)
    focal, cx, cy = (707.0912, 601.8873, 183.1104) if name == "kitti_06" else (721.5377, 609.5593, 172.854)
    inner = "image_{:02d}/data" if "raw" in name else "image_{}"
    lefts = sorted((folder / inner.format(0)).glob("*.png"))[:50:8]
    pairs = []
    for path in lefts:
        left = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        right = cv2.imread(str(folder / inner.format(1) / path.name), cv2.IMREAD_GRAYSCALE)
        pairs.append((left, right))
    camera = StereoCamera(left.shape[1], left.shape[0], focal, cx, cy, 0.537)
    report = summarise(camera, drive(pairs, camera))
    assert report.verdict == "good", report.why
    swapped = [r.failure for r in drive([(right, left) for left, right in pairs], camera)]
    assert sum(f is not None and f.reason is FailureReason.SWAPPED for f in swapped) >= len(pairs) - 1
