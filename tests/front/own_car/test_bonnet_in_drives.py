"""Drives whose pictures show the own car's bonnet: found, left out, said; and those that show none."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereocalib_core.back.analyse import analyse
from stereocalib_core.config import PipelineConfig
from stereocalib_core.files.frame_record import Done, pack, unpack
from stereocalib_core.frames import FrameSource, Recording, StereoFrame
from stereocalib_core.front.pipeline import FrontEnd
from stereocalib_core.front.sight import road_disparity
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.numeric.arrays import Grey, Mask
from stereocalib_core.run.calibrate import Step, follow, told
from stereocalib_core.sources import open_source

CONFIG = PipelineConfig()


def _nearer_px(source: FrameSource) -> int:
    """Disparity of a bonnet a quarter of the camera's height above the road: the matcher and the tracks see it."""
    return round(1.35 * road_disparity(source.camera, Extrinsics(1.65, 0.0, 0.0)))


def _shape(source: FrameSource, right: bool) -> Mask:
    """(H, W) of the bonnet."""
    height, width = source.camera.height, source.camera.width
    shift = _nearer_px(source) if right else 0
    mask = np.zeros((height, width), np.uint8)
    cv2.ellipse(
        mask, (width // 2 - shift, height + height // 9), (2 * width // 5, height // 4), 0, 0, 360, 1, -1
    )
    return mask.astype(np.bool_)


def _with_bonnet(source: FrameSource, glossy: bool) -> Recording:
    """The drive with a lacquered bonnet in both pictures, or one that mirrors what is above it."""

    def painted(picture: Grey, right: bool) -> Grey:
        height, width = picture.shape
        down = np.linspace(0.0, 1.0, height)[:, None]
        if glossy:
            mirrored = cv2.GaussianBlur(np.roll(picture[::-1], -height // 10, axis=0), (0, 0), 3.0)
            paint = 60.0 + 300.0 * (down - 0.8) + 0.35 * mirrored
        else:
            noise = np.random.default_rng(3).normal(size=(height, 2 * width)).astype(np.float32)
            noise = cv2.GaussianBlur(noise, (0, 0), 2.0)
            first = _nearer_px(source) if right else 0
            paint = 60.0 + 40.0 * down + 6.0 * (noise / noise.std())[:, first : first + width]
        over = cv2.GaussianBlur(_shape(source, right).astype(np.float32), (0, 0), 0.8)
        return np.asarray((over * paint + (1.0 - over) * picture).round().clip(0, 255), dtype=np.uint8)

    def load(index: int) -> StereoFrame:
        frame = source[index]
        assert frame.left is not None and frame.right is not None
        return dataclasses.replace(frame, left=painted(frame.left, False), right=painted(frame.right, True))

    return Recording("drive with a bonnet", source.camera, source.timestamps_s, load)


def _followed(source: FrameSource, stop: int) -> list[Step]:
    return list(follow(source, CONFIG, 0, stop))


@pytest.fixture(scope="module")
def small() -> Recording:
    """Rendered, small pictures, a mirroring bonnet."""
    spec = "synthetic:town?frames=40&width=416&height=160&focal_px=240&cx_px=207&cy_px=70"
    return _with_bonnet(open_source(spec), glossy=True)


@pytest.fixture(scope="module")
def rendered(small: Recording) -> list[Step]:
    return _followed(small, 40)


@pytest.fixture
def real(kitti_raw_0009: Path) -> tuple[Recording, list[Step]]:
    source = _with_bonnet(open_source(str(kitti_raw_0009)), glossy=False)
    return source, _followed(source, 30)


def _found_at(steps: list[Step]) -> int:
    """The first frame that is looked at without the bonnet."""
    return next(
        i for i, step in enumerate(steps) if any(c.stage == "own car" for c in step.done.result.checks)
    )


def _on_bonnet(source: FrameSource, step: Step) -> tuple[float, int]:
    """Share of the bonnet in the road's region, and how many points the tracks have on it."""
    look, under = step.look, _shape(source, right=False)
    road, tracks = look.road, look.result.tracks
    assert road is not None and road.region is not None and tracks is not None
    cells, every = road.region.cells, road.disparity.step_px
    share = np.mean(cells[under[::every, ::every][: cells.shape[0], : cells.shape[1]]])
    points = np.rint(tracks.points[:, 3:5]).astype(int)
    return float(share), int(np.count_nonzero(under[points[:, 1], points[:, 0]]))


def test_a_bonnet_in_a_rendered_drive(small: Recording, rendered: list[Step]) -> None:
    at = _found_at(rendered)
    assert 20 < at < 35
    after = rendered[at + 1 :]
    assert all(step.done.result.ok for step in after)
    before, since = ([_on_bonnet(small, step) for step in part] for part in (rendered[5:at], after))
    assert min(share for share, _ in before) > 0.05  # what it mirrors looks like a road
    assert set(since) == {(0.0, 0)}
    results = [step.done.result for step in rendered]
    drive = told(
        analyse(results, small.camera, CONFIG), "drive", small, [step.done for step in rendered], 1.0
    )
    (note,) = drive.notices
    rows = np.count_nonzero(_shape(small, right=False).any(axis=1))
    said = int(note.split("the lowest ")[1].split()[0])
    assert note.startswith("bonnet: ") and abs(said - rows) <= 5 and f"from frame {at} on" in note


@pytest.mark.parametrize(
    "begin", [3, 17, 36], ids=["before any look", "while it is searched", "when it is found"]
)
def test_a_stopped_drive_goes_on_to_the_same_bytes(
    small: Recording, rendered: list[Step], begin: int
) -> None:
    earlier = [unpack(pack(step.done)) for step in rendered[:begin]]
    again = list(follow(small, CONFIG, 0, begin + 4, earlier))
    assert len(again) == 4
    for step, before in zip(again, rendered[begin:], strict=False):
        assert _bytes(step.done) == _bytes(before.done)


def _bytes(done: Done) -> bytes:
    result = dataclasses.replace(done.result, timing_ms={})
    return pack(dataclasses.replace(done, result=result, total_ms=0.0))


def test_a_frame_alone_is_shown_as_the_drive_saw_it(small: Recording, rendered: list[Step]) -> None:
    before = [(step.done.result, step.done.memory) for step in rendered[:38]]
    shown = FrontEnd(small.camera, CONFIG).stages(small[38], before)
    assert shown is not None and shown.estimate is not None and rendered[38].done.result.road is not None
    assert shown.estimate.extrinsics == rendered[38].done.result.road.extrinsics
    assert not np.isfinite(shown.disparity.values[-1, shown.disparity.values.shape[1] // 2])


def test_a_bonnet_in_a_real_drive(real: tuple[Recording, list[Step]], kitti_raw_0009: Path) -> None:
    source, steps = real
    at = _found_at(steps)
    assert at < 28
    clear = FrontEnd(source.camera, CONFIG)
    bare = open_source(str(kitti_raw_0009))
    truth = [clear.step(bare[i]).road for i in range(at - 6, len(steps))]
    after = truth[6:]
    for step, road in zip(steps[at:], after, strict=True):
        seen = step.done.result.road
        assert seen is not None and road is not None
        e, f = seen.extrinsics, road.extrinsics
        off = np.array([e.height_m - f.height_m, e.pitch_rad - f.pitch_rad, e.roll_rad - f.roll_rad])
        assert np.all(np.abs(off) < 3.0 * np.hypot(seen.sigma, road.sigma))
    shares, points = np.transpose([_on_bonnet(source, step) for step in steps[at + 1 :]])
    # a point at its very edge may be road, or its patch have some of both
    assert shares.max() < 0.01 and points.max() <= 1
    # stopped and gone on with, its tracks begin at none of the bonnet's corners either
    again, stop = FrontEnd(source.camera, CONFIG), at + 2
    again.recall([source[stop - 1]], [(step.done.result, step.done.memory) for step in steps[:stop]])
    corners = again._tracker.corners
    assert corners is not None and len(corners.points) > 100
    v, u = np.rint(corners.points[:, 1]).astype(int), np.rint(corners.points[:, 0]).astype(int)
    assert np.count_nonzero(_shape(source, right=False)[v, u]) <= 2
