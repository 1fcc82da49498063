"""Stretches of frames that failed for the same reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from stereocalib_core.results import FrameResult


@dataclass(frozen=True)
class Span:
    """Frames `first` to `last`, all failed for `reason`."""

    first: int
    last: int
    reason: str

    @property
    def words(self) -> str:
        """`4 to 9 · DARK`, or `4 · DARK`."""
        frames = f"{self.first}" if self.first == self.last else f"{self.first} to {self.last}"
        return f"{frames} · {self.reason}"


def failed_spans(results: Sequence[FrameResult]) -> list[Span]:
    """One span per run of failed frames with the same reason, in order."""
    spans: list[Span] = []
    for result in results:
        if result.ok:
            continue
        last = spans[-1] if spans else None
        if last is not None and last.last == result.frame - 1 and last.reason == result.reason:
            spans[-1] = Span(last.first, result.frame, last.reason)
        else:
            spans.append(Span(result.frame, result.frame, result.reason))
    return spans
