"""A few damaged files of every format and dialect; `tests/campaign/fuzz_sources.py` tries thousands."""

from __future__ import annotations

import pytest

pytest.importorskip("rosbags")

from campaign.fuzz_sources import run, table  # noqa: E402


def test_damaged_recordings_are_one_line_or_open() -> None:
    outcome = run(120, seed=7)
    assert not outcome.wrong, table(outcome)
    assert sum(outcome.refused.values()) > 40
    assert outcome.slowest_s < 5.0
