"""All frames of a drive as columns, once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.errors import Failure, FailureReason
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.results.frame import FilteredExtrinsics, FrameResult, RoadEstimate, estimates

if TYPE_CHECKING:
    import pandas

Array = NDArray[np.float64]
AXES = ("height_m", "pitch_rad", "roll_rad")
"""What every frame measures, in the order of the last axis of `values` and its like."""
IN_SI = np.ones(3)
SERIES = ("values", "sigma", "filtered", "filtered_sigma", "smoothed", "smoothed_sigma")


@dataclass(frozen=True)
class Spread:
    """One axis over the frames that are ok ; None where there is none. std_filtered: of `filtered`."""

    mean: float | None = None
    median: float | None = None
    std: float | None = None
    std_filtered: float | None = None


def column_name(axis: str, series: str) -> str:
    """`pitch_rad` in the series `filtered_sigma` is the column `pitch_filtered_sigma_rad`."""
    stem, unit = axis.split("_")
    return axis if series == "values" else f"{stem}_{series}_{unit}"


@dataclass(frozen=True)
class FrameTable:
    """N frames, one entry or row each; NaN = there is none.

    frame: (N,) numbers. elapsed_s: (N,) since epoch_s, the source's; `timestamp_s` is the sum of both.
    ok: (N,) whether the pair shows the road. reason: why not, or empty.
    values, sigma: (N, 3) height [m], pitch, roll [rad] of each pair by itself.
    filtered, filtered_sigma: (N, 3) with the frames before. smoothed, smoothed_sigma: (N, 3) with those after too.
    filter_state: `updated`, `predicted` (no measurement in this frame), or `none`.
    free_fraction: (N,) free pixels / pixels below the horizon. inliers: (N,) what agrees with the plane.

    Every axis of every series is a column of its own name too: `table.pitch_rad`, `table["pitch_filtered_sigma_rad"]`.
    """

    frame: NDArray[np.int64]
    elapsed_s: Array
    ok: NDArray[np.bool_]
    reason: tuple[str, ...]
    values: Array
    sigma: Array
    filtered: Array
    filtered_sigma: Array
    smoothed: Array
    smoothed_sigma: Array
    filter_state: tuple[str, ...]
    free_fraction: Array
    inliers: Array
    epoch_s: float = 0.0

    @classmethod
    def of(
        cls,
        results: Sequence[FrameResult],
        filtered: FilteredExtrinsics | None = None,
        smoothed: FilteredExtrinsics | None = None,
    ) -> FrameTable:
        """The results of the front end, in order, with what the filter made of them."""
        missing = np.full((len(results), 3), np.nan)

        def known(series: FilteredExtrinsics | None) -> tuple[Array, Array]:
            if series is None:
                return missing, missing
            there = np.array([state != "none" for state in series.state], dtype=np.bool_)[:, None]
            return np.where(there, series.values, np.nan), np.where(there, series.sigma, np.nan)

        (now, now_sigma), (back, back_sigma) = known(filtered), known(smoothed)
        roads = [r.road for r in results]
        return cls(
            frame=np.array([r.frame for r in results], dtype=np.int64),
            elapsed_s=np.array([r.timestamp_s for r in results], dtype=np.float64),
            ok=np.array([r.ok for r in results], dtype=np.bool_),
            reason=tuple(r.reason for r in results),
            values=estimates(results),
            sigma=np.array([missing[0] if road is None else road.sigma for road in roads]).reshape(-1, 3),
            filtered=now,
            filtered_sigma=now_sigma,
            smoothed=back,
            smoothed_sigma=back_sigma,
            filter_state=("none",) * len(results) if filtered is None else filtered.state,
            free_fraction=_numbers((r.road or r).free_fraction for r in results),
            inliers=_numbers((r.road or r).inliers for r in results),
        )

    def results(self) -> list[FrameResult]:
        """The frames as results again, as far as a table has them: without tracks, checks and covariances."""
        found = []
        covariances = np.zeros((len(self), 3, 3))
        covariances[:, range(3), range(3)] = self.sigma**2
        unknown = float("nan"), float("nan")
        for i, values in enumerate(self.values.tolist()):
            road = failure = None
            free, inliers = float(self.free_fraction[i]), self.inliers[i]
            count = int(inliers) if np.isfinite(inliers) else 0
            if self.ok[i]:
                road = RoadEstimate(Extrinsics(*values), covariances[i], count, free, unknown)
            elif self.reason[i]:
                failure = Failure(FailureReason(self.reason[i]), "as written by the run")
            time_s = float(self.elapsed_s[i])
            found.append(FrameResult(int(self.frame[i]), time_s, road, failure, free, count))
        return found

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def timestamp_s(self) -> Array:
        """(N,) by the recording's own clock [s]."""
        return self.epoch_s + self.elapsed_s

    @property
    def columns(self) -> Mapping[str, NDArray[Any]]:
        """Every column by its name, (N,) each."""
        return {
            "frame": self.frame,
            "timestamp_s": self.timestamp_s,
            "ok": self.ok,
            "reason": np.array(self.reason, dtype=object),
            **{
                column_name(axis, series): getattr(self, series)[:, k]
                for series in SERIES
                for k, axis in enumerate(AXES)
            },
            "filter_state": np.array(self.filter_state, dtype=object),
            "free_fraction": self.free_fraction,
            "inliers": self.inliers,
        }

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    def __getattr__(self, name: str) -> NDArray[Any]:
        if not name.endswith(("_m", "_rad")):
            raise AttributeError(name)
        try:
            return self.columns[name]
        except KeyError:
            raise AttributeError(name) from None

    def to_pandas(self) -> pandas.DataFrame:
        """The columns as a pandas DataFrame."""
        import pandas

        return pandas.DataFrame(dict(self.columns))

    @property
    def failures(self) -> Mapping[str, int]:
        """How many frames failed for each reason, by name."""
        failed = (reason for reason, ok in zip(self.reason, self.ok, strict=True) if not ok)
        return dict(sorted(Counter(failed).items()))

    def statistics(self, unit: Array = IN_SI) -> Mapping[str, Spread]:
        """Each axis over the frames that are ok, and the spread of the filtered values over the same frames.

        unit: (3,) factors of height, pitch, roll to the unit wanted.
        """
        values, filtered = self.values * unit, self.filtered * unit
        ok = np.isfinite(values).all(axis=1)
        found = {}
        for k, axis in enumerate(AXES):
            raw, flat = values[ok, k], filtered[ok, k]
            flat = flat[np.isfinite(flat)]
            std_filtered = float(np.std(flat)) if len(flat) else None
            found[axis] = Spread(std_filtered=std_filtered)
            if len(raw):
                found[axis] = Spread(
                    float(np.mean(raw)), float(np.median(raw)), float(np.std(raw)), std_filtered
                )
        return found

    def gaps(self, measured: NDArray[np.bool_] | None = None) -> tuple[tuple[int, int], ...]:
        """First and last frame of every run of failed frames, and of frames reached without a measurement.

        measured: (N,) whether the motion into a frame was measured on the road. Into the frame after a failed one
        it seldom is: that is the failed frame's gap, and by itself makes it no longer.
        """
        missing = ~self.ok
        if measured is not None:
            after = np.concatenate([[False], ~self.ok[:-1]]) & np.concatenate([measured[1:], [True]])
            missing = missing | (~measured & ~after)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], missing, [False]]).astype(int))).reshape(
            -1, 2
        )
        return tuple((int(self.frame[first]), int(self.frame[end - 1])) for first, end in edges)


def _numbers(values: Iterator[float | int | None]) -> Array:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
