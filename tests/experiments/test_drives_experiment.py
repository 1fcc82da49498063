"""The road of rendered drives against their truth, a line a drive."""

from __future__ import annotations

import numpy as np
import pytest

from stereocalib_core.errors import ConfigError
from stereocalib_core.experiments.drives import Judged, judge, together


def test_a_part_of_a_drive_is_judged_by_the_truth_of_its_own_frames() -> None:
    whole, part = judge("synthetic:straight?frames=6"), judge("synthetic:straight?frames=6@4:6")
    assert (whole.frames, part.frames) == (6, 2)
    assert len(whole.error) == 6
    assert np.all(np.abs(part.error) < 4 * part.sigma)
    assert np.all(np.abs(whole.error) < np.array([0.01, *np.deg2rad([0.05, 0.1])]))
    with pytest.raises(ConfigError, match="@a:b"):
        judge("synthetic:straight?frames=6@a:b")


def test_known_errors_are_in_the_line() -> None:
    sigma = np.array([0.001, *np.deg2rad([0.01, 0.02])])
    one, other = (Judged(3, np.full((2, 3), size) * sigma, np.tile(sigma, (2, 1))) for size in (0.5, 1.5))
    line = together([one, other]).line("all")
    assert line.startswith("all")
    assert "4/   6" in line
    assert "1.12  0.0112  0.0224" in line
    assert line.endswith("50%  100%")
    down = Judged(3, np.full((3, 3), -0.5) * sigma, np.tile(sigma, (3, 1))).line("down")
    assert "0.50  0.0050  0.0100   -0.50 -0.0050 -0.0100" in down, "the median, and it with its sign"
    assert Judged(3, np.empty((0, 3)), np.empty((0, 3))).line("none").endswith("0/   3")
