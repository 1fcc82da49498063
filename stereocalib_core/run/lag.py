"""Where most frames failed: is it that the right pictures are those of another frame?"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from stereocalib_core.back.causes import SEEN
from stereocalib_core.back.remedies import REMEDIES
from stereocalib_core.config import PipelineConfig
from stereocalib_core.config.verdicts import MIN_OK_FRACTION
from stereocalib_core.errors import FailureReason
from stereocalib_core.frames import FrameSource
from stereocalib_core.front.rows.lag import lag_of, lags_of, matches_by_lag
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.results import Cause, Drive, FrameResult

BLAMED = SEEN | {FailureReason.MISALIGNED}
"""Reasons that pictures of two moments give, none of which says so."""


def with_lag(
    drive: Drive, results: Sequence[FrameResult], source: FrameSource, config: PipelineConfig
) -> Drive:
    """The drive, with UNSYNCHRONISED as its cause where fewer than half the frames are ok and the pictures say so.

    It takes the place of what was blamed on the scene: no truck stood there. A live source can't be asked again:
    whatever it gave next would be another moment.
    """
    if source.live or drive.frames_ok >= MIN_OK_FRACTION * len(drive.frames):
        return drive
    failed = [r.frame for r in results if r.failure is not None and r.failure.reason in BLAMED]
    inside = [i for i in failed if i - config.lag.most >= 0 and i + config.lag.most < len(source)]
    if not inside:
        return drive
    asked = [
        inside[k] for k in np.unique(np.linspace(0, len(inside) - 1, config.lag.frames).round().astype(int))
    ]
    rows = [row for i in asked if (row := _matches(source, i, config)) is not None]
    matches = np.array(rows).reshape(-1, len(lags_of(config.lag)))
    lag = lag_of(matches, config.lag)
    if lag is None:
        return drive
    cause = _cause(lag, matches, failed[0], failed[-1])
    others = (other for other in drive.causes if other.reason not in BLAMED)
    return dataclasses.replace(drive, causes=(cause, *others))


def _matches(source: FrameSource, frame: int, config: PipelineConfig) -> Array | None:
    """(lags,) of one frame, None where a picture is missing or of another camera or size."""
    pairs = [source[frame + lag] for lag in lags_of(config.lag)]
    left = pairs[config.lag.most].left
    rights = [pair.right for pair in pairs if pair.right is not None and pair.camera is None]
    if left is None or len(rights) < len(pairs) or any(right.shape != left.shape for right in rights):
        return None
    return matches_by_lag(source.camera, left, rights, config.rectification)


def _cause(lag: int, matches: Array, first: int, last: int) -> Cause:
    """Both numbers of matches, and which picture belongs to which."""
    reason = FailureReason.UNSYNCHRONISED
    own, best = (int(matches[:, matches.shape[1] // 2 + k].sum()) for k in (0, lag))
    frames = "1 frame" if abs(lag) == 1 else f"{abs(lag)} frames"
    when = "later" if lag > 0 else "earlier"
    words = (
        f"{REMEDIES[reason][0]}: right pictures of {frames} {when} have {best} matches instead of {own}"
        f" in {len(matches)} frames"
    )
    remedy = f"pair left picture i with right picture i{lag:+d}; trigger both cameras together"
    return Cause(first, last, str(reason), words, remedy)
