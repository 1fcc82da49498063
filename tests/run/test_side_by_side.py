"""Neighbouring frames at once give the bits of one after another, and nobody is asked too early."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from stereocalib_core.config import PipelineConfig
from stereocalib_core.config.running import PREPARED_AHEAD, READ_AHEAD
from stereocalib_core.errors import SourceError
from stereocalib_core.frames import FrameSource, Recording, StereoFrame
from stereocalib_core.front.pipeline import FrontEnd
from stereocalib_core.front.road.patches import align
from stereocalib_core.front.tracks import patches, row_patches
from stereocalib_core.results import FrameResult
from stereocalib_core.run import side_by_side
from stereocalib_core.run.calibrate import Step, follow
from stereocalib_core.sources import open_source

FRAMES = 12
LOOPS = {"follow": patches.follow, "match_rows": row_patches.match_rows, "align": align}
"""Those that see pictures."""


@pytest.fixture(scope="module")
def drive() -> Recording:
    """A drive with a frame that is missing, one frozen and one dark."""
    source = open_source(
        f"synthetic:town?frames={FRAMES}&width=416&height=160&focal_px=240&cx_px=207&cy_px=70"
    )
    frames = [source[i] for i in range(FRAMES)]
    frames[5] = replace(frames[5], right=frames[4].right)
    frames[7] = replace(frames[7], left=None, right=None)
    dark = np.zeros((160, 416), np.uint8)
    frames[9] = replace(frames[9], left=dark, right=dark + np.uint8(1))
    return Recording("drive", source.camera, source.timestamps_s, frames.__getitem__)


@pytest.fixture
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(side_by_side, "cores", lambda: 2)


def _bits(result: FrameResult) -> tuple[object, ...]:
    road, tracks, rows = result.road, result.tracks, result.rectification
    return (
        result.frame,
        result.reason,
        None if road is None else (road.extrinsics, road.covariance.tobytes(), road.inliers, road.range_m),
        None if tracks is None else (tracks.points.tobytes(), tracks.on_road.tobytes(), tracks.previous),
        None if rows is None else (rows.values.tobytes(), rows.covariance.tobytes()),
        result.checks,
    )


def _one_by_one(source: FrameSource) -> list[tuple[object, ...]]:
    front_end = FrontEnd(source.camera, PipelineConfig())
    return [_bits(front_end.step(source[i])) for i in range(len(source))]


def test_a_resumed_drive_calls_no_other_compiled_code(drive: Recording, two_cores: None) -> None:
    """What else was compiled in a process would decide which version of a loop it takes, and how that rounds."""
    steps = list(follow(drive, PipelineConfig()))
    known = {name: set(loop.signatures) for name, loop in LOOPS.items()}
    assert all(known.values())
    for first in (1, 4, 8):
        list(follow(drive, PipelineConfig(), earlier=[step.done for step in steps[:first]]))
        assert {name: set(loop.signatures) for name, loop in LOOPS.items()} == known


def test_the_same_bits_as_one_after_another(drive: Recording, two_cores: None) -> None:
    expected = _one_by_one(drive)
    assert [bits[1] for bits in expected].count("") == FRAMES - 3
    steps = list(follow(drive, PipelineConfig()))
    assert [_bits(step.done.result) for step in steps] == expected
    for first in (1, PREPARED_AHEAD, PREPARED_AHEAD + 3, 8):
        earlier = [step.done for step in steps[:first]]
        assert [
            _bits(step.done.result) for step in follow(drive, PipelineConfig(), earlier=earlier)
        ] == expected[first:]


def test_the_same_pixels_give_the_same_bits_wherever_they_come_from(drive: Recording) -> None:
    """Compiled code for parts of pictures, or for pictures that may not be written to, rounds otherwise."""
    wide = [np.zeros((160, 2 * 416), np.uint8) for _ in range(2)]

    def part(index: int) -> StereoFrame:
        frame = drive[index]
        if frame.left is None or frame.right is None:
            return frame
        for picture, image in zip(wide, (frame.left, frame.right), strict=True):
            picture[:, ::2] = image
        return replace(frame, left=wide[0][:, ::2].copy(order="F"), right=wide[1][:, ::2])

    def fixed(index: int) -> StereoFrame:
        frame = drive[index]
        if frame.left is None or frame.right is None:
            return frame
        left, right = frame.left.copy(), frame.right.copy()
        left.flags.writeable = right.flags.writeable = False
        return replace(frame, left=left, right=right)

    owned = _one_by_one(drive)
    for load in (part, fixed):
        assert _one_by_one(Recording("drive", drive.camera, drive.timestamps_s, load)) == owned


def test_on_one_core_nothing_is_prepared_ahead(drive: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(side_by_side, "cores", lambda: 1)
    monkeypatch.setattr(side_by_side, "_ahead", None)
    assert [_bits(step.done.result) for step in follow(drive, PipelineConfig())] == _one_by_one(drive)


def test_a_live_source_is_not_asked_before_its_frame_is_wanted(drive: Recording, two_cores: None) -> None:
    asked: list[int] = []

    def load(index: int) -> StereoFrame:
        asked.append(index)
        return drive[index]

    live = replace(drive, load=load, live=True)
    for count, _ in enumerate(follow(live, PipelineConfig(), 0, 4), 1):
        assert asked == list(range(count))


def test_closed_early_it_reads_no_more_and_reads_ahead_within_bounds(
    drive: Recording, two_cores: None
) -> None:
    asked: list[int] = []

    def load(index: int) -> StereoFrame:
        asked.append(index)
        return drive[index]

    steps: Iterator[Step] = follow(replace(drive, load=load), PipelineConfig())
    next(steps)
    steps.close()  # type: ignore[attr-defined]
    read = tuple(asked)
    assert 1 <= len(read) <= 1 + (PREPARED_AHEAD + 1) + READ_AHEAD < FRAMES
    assert read == tuple(range(len(read)))


def test_what_goes_wrong_ahead_is_told_when_its_frame_is_due(drive: Recording, two_cores: None) -> None:
    config = PipelineConfig()
    calls = FrontEnd(drive.camera, config).matcher

    def fails(left, right, *more, **rest):  # type: ignore[no-untyped-def]
        if np.array_equal(left[-8:], drive[4].left[-8:]):  # type: ignore[index]
            raise SourceError("matcher", "frame 4", "try again")
        return calls(left, right, *more, **rest)

    done = []
    with pytest.raises(SourceError, match="frame 4"):
        for step in follow(drive, config, matcher=fails):
            done.append(step.done.result.frame)
    assert done == [0, 1, 2, 3]


def test_ctrl_c_inside_a_compiled_loop_is_a_ctrl_c(
    drive: Recording, two_cores: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """numba wraps it where it strikes as a loop returns; any other such error is told as it is."""

    def wrapped(cause: BaseException) -> None:
        def look(*_: object) -> None:
            try:
                raise SystemError("returned a result with an exception set") from cause
            except SystemError as error:
                raise SystemError("and so did who called it") from error

        monkeypatch.setattr(FrontEnd, "look", look)
        next(follow(drive, PipelineConfig()))

    with pytest.raises(KeyboardInterrupt):
        wrapped(KeyboardInterrupt())
    with pytest.raises(SystemError):
        wrapped(ValueError())
