"""The log of one pair on the way to its road: what each stage took, and what it was judged by."""

from __future__ import annotations

import dataclasses
import time
from dataclasses import dataclass, field

from stereocalib_core.errors import Failure
from stereocalib_core.front.road.result import RoadResult
from stereocalib_core.results import Check, RoadEstimate


@dataclass
class Notes:
    """The log of one pair: what every stage took, and what it was judged by."""

    checks: list[Check] = field(default_factory=list)
    timing_ms: dict[str, float] = field(default_factory=dict)
    _mark: float = field(default_factory=time.perf_counter)

    @classmethod
    def of(cls, road: RoadResult) -> Notes:
        """To be gone on with, from now on."""
        return cls(list(road.checks), dict(road.timing_ms))

    def lap(self, stage: str) -> None:
        """Books the time since the last lap to `stage`."""
        now = time.perf_counter()
        self.timing_ms[stage] = self.timing_ms.get(stage, 0.0) + 1e3 * (now - self._mark)
        self._mark = now

    def check(
        self,
        stage: str,
        name: str,
        value: float,
        low: float | None = None,
        high: float | None = None,
        unit: str = "",
    ) -> bool:
        """Keeps the value beside its limits; is it within them?"""
        result = Check(stage, name, float(value), low, high, unit)
        self.checks.append(result)
        return result.ok

    def end(
        self, road: RoadResult, failure: Failure | None = None, estimate: RoadEstimate | None = None
    ) -> RoadResult:
        """`road` with this log, and how it ends."""
        return dataclasses.replace(
            road, estimate=estimate, failure=failure, checks=tuple(self.checks), timing_ms=self.timing_ms
        )
