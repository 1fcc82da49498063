"""What is kept of a scan and of its pictures: a box before a wall with known edges, then a real drive."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path

import numpy as np
import pytest

from stereocalib_core.config import PipelineConfig, ScanSampleConfig
from stereocalib_core.front.scan.scan_sample import beam_after_beam, sample_scan
from stereocalib_core.front.scan.view import ScanView
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.results import DisparityMap, ScanSample

CONFIG = ScanSampleConfig()
CAMERA = StereoCamera(640, 240, 400.0, 319.5, 119.5, 0.5)
T_CAMERA_LIDAR = np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
BOX_M, WALL_M = 8.0, 20.0
LEFT_M, RIGHT_M = -1.0, 2.0
"""The box stands between these x, 8 m ahead, before a wall at 20 m; both are planes across."""


def scan_of_box(step_deg: float = 0.2, beams: int = 16) -> np.ndarray:
    """(N, 4) beam after beam, azimuth growing, LiDAR and camera in one place."""
    azimuth, rise = np.meshgrid(
        np.deg2rad(np.arange(-35.0, 35.0, step_deg)), np.deg2rad(np.linspace(-8, 8, beams))
    )
    ray = np.stack([np.cos(azimuth) * np.cos(rise), np.sin(azimuth) * np.cos(rise), np.sin(rise)], axis=-1)
    side = -ray[..., 1] / ray[..., 0]
    depth = np.where((side * BOX_M > LEFT_M) & (side * BOX_M < RIGHT_M), BOX_M, WALL_M)
    points = ray * (depth / ray[..., 0])[..., None]
    return np.concatenate([points.reshape(-1, 3), np.zeros((points.size // 3, 1))], axis=1).astype(np.float32)


def pictures() -> tuple[np.ndarray, DisparityMap]:
    """The left picture, box bright and wall dark, and its disparity, in which the box is 3 px too wide on each side."""
    u = np.arange(CAMERA.width, dtype=float)
    edges = [CAMERA.focal_px * x / BOX_M + CAMERA.cx_px for x in (LEFT_M, RIGHT_M)]
    # each pixel shows the mean of what it covers
    share = np.clip(u + 0.5 - edges[0], 0, 1) - np.clip(u + 0.5 - edges[1], 0, 1)
    picture = np.tile(np.round(60 + 100 * share), (CAMERA.height, 1)).astype(np.uint8)
    centre = (np.arange(CAMERA.width // 2) + 0.5) * 2 - 0.5
    row = np.where((centre > edges[0] - 3) & (centre < edges[1] + 3), BOX_M, WALL_M)
    values = CAMERA.focal_px * CAMERA.baseline_m / row
    return picture, DisparityMap(np.tile(values, (CAMERA.height // 2, 1)).astype(np.float32), 2)


def viewed(scan: np.ndarray) -> ScanView:
    return ScanView.of(scan, CAMERA, T_CAMERA_LIDAR, CONFIG)


def sampled(scan: np.ndarray, road: Extrinsics | None = None) -> ScanSample:
    return sample_scan(viewed(scan), *pictures(), CAMERA, road, CONFIG)


def test_beam_edges_lie_within_half_a_step_of_the_box_on_the_right_side() -> None:
    edges = sampled(scan_of_box(step_deg=0.05)).beam_edges
    assert len(edges) == 2 * 16
    for side, x in ((1.0, LEFT_M), (-1.0, RIGHT_M)):
        mine = edges[edges[:, 3] == side]
        # side +1: the box lies right of its left edge
        assert len(mine) == 16
        angle = np.arctan2(-mine[:, 1], mine[:, 0])
        np.testing.assert_allclose(angle, np.arctan2(x, BOX_M), atol=np.deg2rad(0.03))
        np.testing.assert_allclose(mine[:, 0], BOX_M, atol=0.02)


def test_picture_edges_are_where_the_picture_has_them_and_not_the_matcher() -> None:
    edges = sampled(scan_of_box()).picture_edges
    near = CAMERA.focal_px * CAMERA.baseline_m / BOX_M
    for side, x in ((1.0, LEFT_M), (-1.0, RIGHT_M)):
        mine = edges[edges[:, 3] == side]
        assert len(mine) > 50
        np.testing.assert_allclose(mine[:, 0], CAMERA.focal_px * x / BOX_M + CAMERA.cx_px, atol=0.5)
        np.testing.assert_allclose(mine[:, 2], near, atol=0.07)
    assert np.all(np.diff(edges[:, 1]) >= 0)


def test_surfaces_are_planes_with_their_slope_and_points_are_off_edges() -> None:
    sample = sampled(scan_of_box())
    depths = np.unique(np.round(CAMERA.focal_px * CAMERA.baseline_m / sample.patches[:, 2], 1))
    np.testing.assert_allclose(depths, [BOX_M, WALL_M])
    np.testing.assert_allclose(sample.patches[:, 3:], 0.0, atol=1e-3)
    jump = np.abs(np.abs(sample.points[:, 0] - BOX_M) - (WALL_M - BOX_M))
    assert np.all((np.abs(sample.points[:, 0] - BOX_M) < 0.01) | (jump < 0.01)) and len(sample.points) > 100
    _, flat = pictures()
    slanted = dataclasses.replace(
        flat, values=flat.values * 0 + 20.0 + 0.01 * np.arange(320, dtype=np.float32) * 2
    )
    patches = sample_scan(viewed(scan_of_box()), pictures()[0], slanted, CAMERA, None, CONFIG).patches
    np.testing.assert_allclose(patches[:, 3], 0.01, atol=1e-4)
    np.testing.assert_allclose(patches[:, 2], 20.0 + 0.01 * (patches[:, 0] - 0.5), atol=0.02)


def test_what_lies_on_the_road_is_no_surface() -> None:
    # a camera 0.5 m over the road: the lower part of box and wall is within 0.3 m of it
    over = sampled(scan_of_box(), Extrinsics(0.5, 0.0, 0.0))
    free = sampled(scan_of_box())
    assert 0 < len(over.patches) < len(free.patches)
    limit = CONFIG.clear_of_road_m - 0.5
    assert free.points[:, 2].min() < limit - 1.0 and over.points[:, 2].min() > limit - 0.01


def test_a_cloud_written_firing_by_firing_gives_the_same_edges() -> None:
    scan = scan_of_box()
    columns = scan.reshape(16, -1, 4).transpose(1, 0, 2).reshape(-1, 4)
    assert beam_after_beam(scan[:, :3], CONFIG) is not None
    one, other = sampled(scan).packed_beam_edges, sampled(columns).packed_beam_edges
    assert len(one) and sorted(map(tuple, one)) == sorted(map(tuple, other))


def test_an_empty_scan_and_a_blank_map_give_nothing() -> None:
    sample = sampled(np.zeros((0, 4), np.float32))
    assert len(sample.beam_edges) == 0 and len(sample.points) == 0
    picture, flat = pictures()
    blank = dataclasses.replace(flat, values=np.full_like(flat.values, np.nan))
    sample = sample_scan(viewed(scan_of_box()), picture, blank, CAMERA, None, CONFIG)
    assert len(sample.picture_edges) == 0 and len(sample.patches) == 0 and len(sample.beam_edges) > 0


def test_packed_numbers_come_back_within_their_step() -> None:
    rng = np.random.default_rng(0)
    beams = np.column_stack([rng.uniform(-100, 100, (50, 3)), rng.choice([-1.0, 1.0], 50)])
    edges = np.column_stack(
        [rng.uniform(0, 4000, (50, 3)), rng.choice([-1.0, 1.0], 50), rng.uniform(0, 90, 50)]
    )
    patches = np.column_stack([rng.uniform(0, 500, (50, 3)), rng.uniform(-1, 1, (50, 2))])
    sample = ScanSample.pack(np.eye(4), beams, edges, beams[:, :3], patches)
    np.testing.assert_allclose(sample.beam_edges, beams, atol=0.0021)
    np.testing.assert_allclose(sample.picture_edges, edges, atol=0.07)
    np.testing.assert_allclose(sample.patches, patches, atol=0.07)
    np.testing.assert_allclose(sample.patches[:, 3:], patches[:, 3:], atol=1e-4)


@pytest.fixture(scope="module")
def real(kitti_raw_0009: Path):  # type: ignore[no-untyped-def]
    from stereocalib_core.front.pipeline import FrontEnd
    from stereocalib_core.sources import open_source

    source = open_source(str(kitti_raw_0009))
    front_end = FrontEnd(source.camera, PipelineConfig(), T_camera_lidar=source.T_camera_lidar)
    frames = [source[i] for i in (10, 11, 12)]
    return source, frames, [front_end.step(frame) for frame in frames]


def test_real_frames_keep_little_and_nothing_without_a_scan(real) -> None:  # type: ignore[no-untyped-def]
    _, frames, results = real
    assert frames[2].lidar is None and results[2].scan is None
    assert results[0].scan.sweep == -1.0
    sample = results[0].scan
    assert len(sample.beam_edges) > 200 and len(sample.picture_edges) > 600
    kept = (
        sample.packed_beam_edges,
        sample.packed_picture_edges,
        sample.packed_points,
        sample.packed_patches,
    )
    assert sum(a.nbytes for a in kept) < 30_000


def test_frames_bin_gives_the_sample_back_bit_for_bit(real, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    from stereocalib_core.files.frame_record import Done
    from stereocalib_core.files.frames_bin import Checkpoint, RunKey, read_checkpoint
    from stereocalib_core.results import FrontEndMemory

    key = RunKey(
        "a",
        StereoCamera(1242, 375, 721.5, 609.6, 172.9, 0.537),
        PipelineConfig(),
        first_frame=real[2][0].frame,
    )
    checkpoint = Checkpoint(tmp_path / "checkpoint.bin", key)
    for result in real[2]:
        checkpoint.append(Done(result, FrontEndMemory(None, None), 1.0))
    checkpoint.close()
    again = [done.result for done in read_checkpoint(tmp_path / "checkpoint.bin", key)[0]]
    assert again[2].scan is None
    for before, after in zip(real[2][:2], again[:2], strict=True):
        for field in dataclasses.fields(ScanSample):
            one, other = (np.array(getattr(r.scan, field.name)) for r in (before, after))
            assert one.dtype == other.dtype and one.tobytes() == other.tobytes()


def test_a_scan_takes_little_time(real) -> None:  # type: ignore[no-untyped-def]
    from stereocalib_core.front.matching import compute

    source, frames, results = real
    config = PipelineConfig()
    disparity = compute(frames[0].left, frames[0].right, source.camera, config.disparity)
    times = []
    for _ in range(20):
        began = time.thread_time()
        view = ScanView.of(frames[0].lidar, source.camera, source.T_camera_lidar, config.scan_sample)
        sample_scan(
            *(view, frames[0].left, disparity, source.camera, results[0].road.extrinsics, config.scan_sample)
        )
        times.append(time.thread_time() - began)
    # 2.5 ms on the reference machine; five times that, since others may be at work on it
    assert min(times) < 0.0125
