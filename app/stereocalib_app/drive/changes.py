"""What changed between two frames: the numbers of the stages, ranked by how far they moved for what they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereocalib_core.results import Check, FrameResult

LEAST = 0.25
"""A number that moved by less than this share of itself, or of the way to its limit, is left out."""


@dataclass(frozen=True)
class Change:
    """One number in two frames. rank: how far it moved; what left its limits comes first."""

    name: str
    before: float
    now: float
    unit: str
    outside: bool
    rank: float

    @property
    def words(self) -> str:
        """`mean grey: 92 before, 4 now, outside its limit`."""
        unit = "°" if self.unit == "deg" else f" {self.unit}" if self.unit else ""
        tail = ", outside its limit" if self.outside else ""
        return f"{self.name}: {self.before:.3g}{unit} before, {self.now:.3g}{unit} now{tail}".replace(
            "-", "−"
        )


def _rank(before: Check, now: Check) -> float:
    """How far a number moved, as a share of the larger of the two."""
    scale = max(abs(before.value), abs(now.value), 1e-9)
    return float(abs(now.value - before.value) / scale)


def changed(before: FrameResult, now: FrameResult) -> list[Change]:
    """The numbers that both frames have and that moved, those outside their limits first, then the farthest."""
    known = {(check.stage, check.name): check for check in before.checks}
    found = []
    for check in now.checks:
        old = known.get((check.stage, check.name))
        if old is None or not np.isfinite([old.value, check.value]).all():
            continue
        rank = _rank(old, check)
        if rank >= LEAST or not check.ok:
            found.append(Change(check.name, old.value, check.value, check.unit, not check.ok, rank))
    return sorted(found, key=lambda change: (not change.outside, -change.rank))
