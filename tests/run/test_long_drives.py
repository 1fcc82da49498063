"""A long drive made of a short one: the bench's frames follow each other as those of a real drive do."""

from __future__ import annotations

import numpy as np

from stereocalib_core.benches.long_drive import repeated
from stereocalib_core.files.frame_record import Done
from stereocalib_core.results import FrameResult, FrontEndMemory, Tracks


def test_frames_of_a_short_drive_follow_each_other_again_and_again() -> None:
    points = np.zeros((1, 6), np.float32)
    short = [
        Done(
            FrameResult(
                i, 7.0 + i, None, tracks=None if i == 0 else Tracks(points + i, np.ones(1, bool), i - 1)
            ),
            FrontEndMemory(i, None),
            1.0,
        )
        for i in range(3)
    ]
    results = [done.result for done in repeated(short, 7)]
    assert [r.frame for r in results] == list(range(7))
    np.testing.assert_allclose(np.diff([r.timestamp_s for r in results]), 0.1)
    # all but the first lead on from the frame before, with the tracks of frames 1, 2, 1, 2, ...
    assert results[0].tracks is None
    assert [(r.tracks.previous, r.tracks.points[0, 0]) for r in results[1:] if r.tracks is not None] == [
        (i, 1.0 + i % 2) for i in range(6)
    ]
