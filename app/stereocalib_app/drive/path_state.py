"""All paths of a page with their errors against the truth, as the core computes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from stereocalib_app.drive.paths import DrivePaths
from stereocalib_app.drive.settings import Corrections
from stereocalib_core.back.evaluation import OdometryErrors, errors_along, evaluate
from stereocalib_core.config import OdometryConfig
from stereocalib_core.errors import StereoCalibError
from stereocalib_core.frames import GroundTruth
from stereocalib_core.numeric.arrays import Array


@dataclass(frozen=True)
class PathErrors:
    """One path against the truth. distance_m, miss_m, heading_deg: (M,) along the drive, or None."""

    summary: OdometryErrors
    distance_m: Array | None = None
    miss_m: Array | None = None
    heading_deg: Array | None = None


@dataclass(frozen=True)
class PathState:
    """Poses (N, 4, 4) by name, and their errors. `live` is there only when the corrections are touched."""

    poses: Mapping[str, Array] = field(default_factory=lambda: MappingProxyType({}))
    errors: Mapping[str, PathErrors] = field(default_factory=lambda: MappingProxyType({}))


def compare(poses: Array, truth: GroundTruth | None, measured_share: float = 1.0) -> PathErrors:
    """One path against the truth as far as it goes; no figures where most of it was not measured on a road."""
    least = OdometryConfig().min_measured
    true_poses = None if truth is None else truth.poses
    reliable = truth is None or truth.heading_reliable
    try:
        summary = evaluate(poses, true_poses, reliable, measured_share, least)
        if summary.path_m is None or true_poses is None or not reliable or len(poses) < 2:
            return PathErrors(summary)
        distance, miss, heading = errors_along(poses, true_poses)
    except StereoCalibError:
        # No two frames with a true pose: nothing to compare with.
        return PathErrors(evaluate(poses, None, True, measured_share, least))
    return PathErrors(summary, distance, miss, np.rad2deg(heading))


class PathBook:
    """Keeps the variants of one `DrivePaths`, so that a slider only computes the live path."""

    def __init__(self, truth: GroundTruth | None) -> None:
        self._truth = truth
        self._paths: DrivePaths | None = None
        self._saved: PathState | None = None
        self._variants: dict[tuple[str, str], PathState] = {}

    def saved(self, poses: Array | None) -> PathState:
        """The one path that an earlier run wrote."""
        if poses is None or len(poses) < 2:
            return PathState()
        if self._saved is None:
            errors = {"autocalibrated": compare(poses, self._truth)}
            found = {"autocalibrated": poses}
            if self._truth is not None and self._truth.poses is not None:
                found = {"ground_truth": self._truth.poses, **found}
            self._saved = PathState(found, errors)
        return self._saved

    def state(self, paths: DrivePaths | None, corrections: Corrections) -> PathState:
        """Every path under the page's corrections."""
        if paths is None or len(paths) < 2:
            return PathState()
        if paths is not self._paths:
            self._paths, self._variants = paths, {}
        key = (corrections.source, corrections.model)
        if key not in self._variants:
            variants = paths.variants(*key)
            found = {name: t.poses for name, t in variants.items()}
            errors = {name: compare(t.poses, self._truth, t.measured_share) for name, t in variants.items()}
            if self._truth is not None and self._truth.poses is not None:
                found = {"ground_truth": self._truth.poses, **found}
            self._variants[key] = PathState(found, errors)
        base = self._variants[key]
        if not corrections.touched:
            return base
        live = paths.live(corrections)
        errors = {**base.errors, "live": compare(live.poses, self._truth, live.measured_share)}
        return PathState({**base.poses, "live": live.poses}, errors)
