"""Words of the page that people act on: causes, changes, names of files, what the truth is good for, layout."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from stereocalib_app.drive.card import truth_words
from stereocalib_app.drive.exports import file_name
from stereocalib_app.drive.panels.debug import changes_words, verdict
from stereocalib_app.drive.session import Snapshot
from stereocalib_app.drive.settings import Corrections, Settings
from stereocalib_app.server.hub import MAIN_WIDTH_PX, timeline_width, views_width
from stereocalib_app.widgets.page_base import PageBase
from stereocalib_app.widgets.text import duration

from stereocalib_core.back.spans import failed_spans
from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import Failure, FailureReason
from stereocalib_core.frames import GroundTruth
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.results import Cause, Check, Drive, FrameResult, RoadEstimate


def frame(number: int, grey: float, ok: bool = True) -> FrameResult:
    checks = (
        Check("image", "mean grey", grey, low=10.0),
        Check("image", "texture", 2.0 if ok else 1.0, low=0.8, unit="grey/px"),
        Check("lane", "free share", 0.9 if ok else 0.3, low=0.1),
    )
    if not ok:
        return FrameResult(
            number, 0.1 * number, None, Failure(FailureReason.DARK, "mean grey 4"), checks=checks
        )
    road = RoadEstimate(Extrinsics(1.65, 0.01, 0.0), np.eye(3) * 1e-6, 100, 0.5, (4, 20))
    return FrameResult(number, 0.1 * number, road, checks=checks)


def moment_at(number: int, results: tuple[FrameResult, ...], causes: tuple[Cause, ...]) -> Any:
    drive = Drive.of_frames(results, PipelineConfig())
    from dataclasses import replace

    snapshot = Snapshot(len(results), results, replace(drive, causes=causes))
    return SimpleNamespace(frame=number, result=results[number], snapshot=snapshot)


RESULTS = (
    frame(0, 92.0),
    frame(1, 90.0),
    frame(2, 4.0, ok=False),
    frame(3, 4.0, ok=False),
    *(frame(n, 91.0) for n in range(4, 16)),
)


def test_what_changed_is_ranked_with_both_numbers() -> None:
    """By the same ranking as the drive's causes: nearest to the light first, what has not moved not at all."""
    words = changes_words(moment_at(2, RESULTS, ()))
    lines = [line for line in words.splitlines() if line.startswith("- ")]
    assert [line[:20] for line in lines] == ["- grey 4 instead of ", "- texture 1\\.0 inste"]
    assert "grey 4 instead of 91" in lines[0]
    assert changes_words(moment_at(1, RESULTS, ())) == ""


def test_a_failed_frame_names_the_drives_causes_first() -> None:
    night = Cause(2, 3, "DARK", "it is <b>night</b>", "raise the exposure")
    lens = Cause(2, 3, "DARK", "the lens is covered", "look at it")
    words = verdict(moment_at(2, RESULTS, (night, lens, Cause(0, 1, "DARK", "not this", "no"))))
    assert "failed: DARK" in words
    assert words.index("night") < words.index("the lens is covered") < words.index("grey 4 instead of 91")
    assert "<b>" not in words.replace("<b style", "")
    assert "not this" not in words
    plain = verdict(moment_at(2, RESULTS, ()))
    assert "Likely cause" in plain
    assert "against the good frames" in plain


def test_a_doubtful_frame_is_not_called_within_its_limits() -> None:
    doubt = Cause(4, 4, "INCONSISTENT", "another plane than the rig stands on", "look at frame 4")
    words = verdict(moment_at(4, RESULTS, (doubt,)))
    assert "another plane" in words
    assert "within its limits" not in words
    assert "within its limits" in verdict(moment_at(4, RESULTS, ()))


def test_spans_not_single_frames() -> None:
    assert [span.words for span in failed_spans(RESULTS)] == ["2 to 3 · DARK"]


def test_files_say_which_drive_and_settings_they_hold() -> None:
    source = SimpleNamespace(name="synthetic:town?frames=24&fault=night@14-16")
    session: Any = SimpleNamespace(source=source, frames=None)
    assert file_name(session, Settings(), "trajectory.tum") == (
        "synthetic_town_frames=24_fault=night_14-16_trajectory.tum"
    )
    session.frames = (10, 30)
    moved = Settings(corrections=Corrections(pitch_error_deg=0.5), follow=False)
    assert file_name(session, moved, "report.json").endswith("_pitch_error_deg=0.5_frames_10-29_report.json")
    source.name = "../<img src=x>" * 40
    name = file_name(session, Settings(), "a.csv")
    assert len(name) < 140
    assert not set(name) & set('/\\<>"')


def test_what_the_truth_is_good_for() -> None:
    poses = np.tile(np.eye(4), (3, 1, 1))
    assert "none in this recording" in truth_words(None)
    assert "position and heading" in truth_words(GroundTruth(poses))
    assert "length of the path only" in truth_words(GroundTruth(poses, heading_reliable=False))


@pytest.mark.parametrize(("width", "height"), [(1600, 900), (1280, 720), (1024, 768), (1200, 660)])
def test_panels_do_not_overlap(width: int, height: int) -> None:
    views = views_width(height, width)
    between = width - views - MAIN_WIDTH_PX
    assert views >= 260
    assert timeline_width(between) + 16 <= between
    assert between >= 390


def test_time_left_in_words() -> None:
    assert [duration(s) for s in (0.4, 59.4, 60, 200, 3900)] == [
        "0 s",
        "59 s",
        "1 min 0 s",
        "3 min 20 s",
        "1 h 5 min",
    ]


def test_notes_replace_each_other() -> None:
    shown: list[str] = []

    class Note:
        def __init__(self, title: str) -> None:
            self.title = title
            shown.append(title)

        def remove(self) -> None:
            shown.remove(self.title)

    client = SimpleNamespace(client_id=3, add_notification=lambda title, *_args, **_more: Note(title))
    page = PageBase(None)
    page.tell(client, "one", "")
    page.tell(client, "two", "")
    assert shown == ["two"]
