"""A row of the time line: signals over the frames that share an axis, as plain arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stereocalib_app.drive.path_state import PathState
from stereocalib_app.drive.session import Snapshot
from stereocalib_app.widgets import palette
from stereocalib_core.frames import GroundTruth
from stereocalib_core.results import Drive

Values = NDArray[np.float64]


@dataclass(frozen=True)
class Trace:
    """One signal: (N,) `values` over the frames, NaN = none, never bridged; sigma: (N,) or None."""

    name: str
    values: Values
    color: palette.Rgb
    style: Literal["line", "dots", "dashed"] = "line"
    sigma: Values | None = None


@dataclass(frozen=True)
class Row:
    """Signals of one kind and unit. least_span: the range is never smaller, so that noise stays small.

    limits: lower and upper limit, None = none; drawn as lines.
    """

    key: str
    label: str
    unit: str
    group: str
    traces: tuple[Trace, ...]
    least_span: float = 0.0
    limits: tuple[float | None, float | None] = (None, None)


@dataclass(frozen=True)
class Known:
    """All that a signal may be made from; N frames in the drive."""

    snapshot: Snapshot
    times_s: Values
    truth: GroundTruth | None
    paths: PathState
    compared: Drive | None = None

    @property
    def total(self) -> int:
        """Frames in the drive."""
        return self.snapshot.total

    def column(self, of: Sequence[float] | Values) -> Values:
        """(N,) with the first values as given, NaN beyond."""
        out = np.full(self.total, np.nan)
        given = np.asarray(of, dtype=np.float64)[: self.total]
        out[: len(given)] = given
        return out


Signals = Callable[[Known], list[Row]]
