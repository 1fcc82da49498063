"""Causes in the last lines of a run: the longest stretches, in the order of the drive, and how many more there are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from stereocalib_app.words.answer import answer

from stereocalib_core.config import PipelineConfig
from stereocalib_core.results import Cause, Drive


def told(*spans: tuple[int, int]) -> list[str]:
    causes = tuple(Cause(first, last, "NO_ROAD", "a truck", "wait") for first, last in spans)
    drive = replace(Drive.of_frames([], PipelineConfig()), causes=causes)
    return [line.strip() for line in answer(drive, Path("nowhere")) if "NO_ROAD" in line or "stretch" in line]


def test_a_few_causes_are_all_told() -> None:
    assert told() == []
    assert told((4, 4), (7, 9)) == [
        "frame 4: NO_ROAD, probably a truck; remedy: wait",
        "frames 7 to 9: NO_ROAD, probably a truck; remedy: wait",
    ]


def test_of_many_the_longest_in_order() -> None:
    lines = told((0, 0), (2, 3), (5, 8), (10, 11), (13, 14), (16, 17), (19, 19))
    assert [line.split(":")[0] for line in lines[:-1]] == [
        "frames 2 to 3", "frames 5 to 8", "frames 10 to 11", "frames 13 to 14", "frames 16 to 17",
    ]  # fmt: skip
    assert lines[-1].startswith("2 more such stretches")
