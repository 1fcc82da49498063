"""A drive in the background: results in order, snapshots that do not change, an end in every case."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from conftest import until
from stereocalib_app.drive import session as session_module
from stereocalib_app.drive.session import Session, Snapshot

from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import Failure, FailureReason, SourceError
from stereocalib_core.frames import Recording, StereoFrame
from stereocalib_core.front import pipeline
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.results import FrameResult, FrontEndMemory, RoadEstimate

CAMERA = StereoCamera(64, 48, 50.0, 32.0, 24.0, 0.5)


class Pretender:
    """A front end without pixels: every third frame fails."""

    memory = FrontEndMemory(None, None)
    pasts = (None, None)

    def __init__(self, *_: Any) -> None:
        self.seen: list[int] = []

    def prepare(self, *_: Any) -> None:
        pass

    def look(self, frame: StereoFrame, *_: Any) -> pipeline.Look:
        return pipeline.Look(self.step(frame))

    def step(self, frame: StereoFrame) -> FrameResult:
        assert not self.seen or frame.index == self.seen[-1] + 1
        self.seen.append(frame.index)
        if frame.index == 13:
            raise ZeroDivisionError
        if frame.index % 3 == 2:
            return FrameResult(frame.index, frame.timestamp_s, None, Failure(FailureReason.DARK, "dark"))
        road = RoadEstimate(Extrinsics(1.6, 0.01, 0.0), np.eye(3) * 1e-6, 9, 0.5, (4.0, 20.0))
        return FrameResult(frame.index, frame.timestamp_s, road)

    def stages(self, frame: StereoFrame) -> None:
        return None


@pytest.fixture(autouse=True)
def _pretend(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session_module, "FrontEnd", Pretender)
    monkeypatch.setattr(pipeline, "FrontEnd", Pretender)


def drive(count: int, fails_at: int | None = None) -> Recording:
    def load(index: int) -> StereoFrame:
        if index == fails_at:
            raise SourceError("disk gone", "somewhere", "plug it in")
        return StereoFrame(index, 0.1 * index, None, None)

    return Recording("pretended", CAMERA, 0.1 * np.arange(count), load)


def test_results_come_in_order_and_failures_are_listed() -> None:
    session = Session(drive(10), PipelineConfig())
    empty = session.snapshot
    session.start()
    assert session.wait(20.0)
    done = session.snapshot
    assert [r.frame for r in done.results] == list(range(10))
    assert done.failures().tolist() == [2, 5, 8]
    assert done.progress == 1.0
    assert done.result(99) is None
    assert empty == Snapshot(total=10)
    assert done.paths is not None
    assert len(done.paths) == 10


def test_analysis_sees_every_result_at_the_end() -> None:
    seen: list[int] = []

    def analyse(results: Sequence[FrameResult]) -> None:
        seen.append(len(results))

    session = Session(drive(9), PipelineConfig(), analyse=analyse)
    session.start()
    assert session.wait(20.0)
    assert seen[-1] == 9


def test_a_source_that_breaks_is_told_on_the_page() -> None:
    session = Session(drive(10, fails_at=4), PipelineConfig())
    session.start()
    until(lambda: session.snapshot.done, what="end")
    assert "disk gone" in session.snapshot.problem
    assert len(session.snapshot.results) == 4


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_an_unexpected_end_does_not_leave_the_page_waiting() -> None:
    session = Session(drive(20), PipelineConfig())
    session.start()
    until(lambda: session.snapshot.done, what="end")
    assert "unexpectedly" in session.snapshot.problem


def test_closing_stops_early() -> None:
    session = Session(drive(12), PipelineConfig())
    session.start()
    session.close()
    assert not session._thread.is_alive()
