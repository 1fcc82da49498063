"""A page as words of the command line, and back."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

import pytest
from stereocalib_app.drive.page_words import from_words, to_words
from stereocalib_app.drive.settings import Corrections, Settings

from stereocalib_core.errors import ConfigError

FULL = Settings(
    "Teach",
    "v-disparity",
    Corrections(0.0, 0.5, 1.0, 0.25, -0.25, 1.5, 0.01, -0.1, "raw", "nonholonomic"),
    follow=False,
    cloud=False,
    markers=True,
    color_by_error=True,
    teach_step=4,
    broken_stage="no obstacles",
    paths=MappingProxyType({"no_roll": False, "live": False}),
)


def test_a_page_comes_back_from_its_words() -> None:
    assert from_words(to_words(FULL)) == FULL
    assert to_words(Settings()) == []
    assert from_words([]) == Settings()
    assert to_words(replace(Settings(), preset="Debug")) == ["preset=Debug"]


@pytest.mark.parametrize(
    "word",
    [
        *("preset=Play", "layout=", "follow=yes", "teach_step=99", "teach_step=1.5", "pitch_error_deg=nan"),
        *("pitch_error_deg=2.1", "yaw_strength=-1", "height_error_m=x", "hide=none", "colour=red", "=", ""),
    ],
)
def test_other_words_are_one_line(word: str) -> None:
    with pytest.raises(ConfigError, match="--set"):
        from_words([word])
