"""Height, pitch and roll of a whole drive: the filter forwards, then a look back over unbroken stretches."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.back.odometry.packing import PackedTracks, pack
from stereocalib_core.back.rig.carried import motions
from stereocalib_core.back.rig.consistency import settled
from stereocalib_core.back.rig.road_points import Look, road_planes
from stereocalib_core.config import PipelineConfig
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.spill import let_go, roomy
from stereocalib_core.results import FilteredExtrinsics, FrameResult

LET_GO_EVERY = 1000
"""Frames, after which what a look back will need, or has passed, leaves the memory."""


class FilteredDrive(NamedTuple):
    """filtered: what was known at each frame, of it and the frames before. smoothed: later frames have their say."""

    filtered: FilteredExtrinsics
    smoothed: FilteredExtrinsics


def filter_drive(
    results: Sequence[FrameResult],
    camera: StereoCamera,
    config: PipelineConfig | None = None,
    tracks: PackedTracks | None = None,
) -> FilteredDrive:
    """The extrinsics of a drive after the filter, forwards, and after a look back (Rauch, Tung, Striebel).

    With the method `paper`, whose stated covariance knows nothing of camber and twist, tracked road points count
    where they are surer; the direct alignment is as sure as they are.

    tracks: of the same frames, where they are packed already; they show how the camera moved from each to the next.

    The look back goes over every stretch of `updated` frames. What was predicted stays as it was predicted: later
    frames do not bridge a gap.
    """
    # not before a drive is filtered: filterpy takes long to import
    from stereocalib_core.back.rig.body_filter import PACKED, RigFilter, measured_covariance, seen

    config, count = config or PipelineConfig(), len(results)
    tracks = tracks or pack(camera, results, config.odometry)
    rig = RigFilter(camera, config.filter, config.vehicle)
    states: list[str] = []
    joined = np.zeros(count, dtype=bool)
    values, covariance, persistent = np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros((count, 3, 3))
    aside = roomy((count, PACKED))
    seen_so = measurements(results, tracks, config)
    for i, (result, looks, moved) in enumerate(zip(results, seen_so, motions(tracks), strict=True)):
        step = rig.step(result.timestamp_s, *looks, moved=moved)
        values[i], covariance[i], persistent[i] = step.values, step.covariance, rig.persistent
        aside[i], joined[i] = step.packed(), step.joined
        states.append(step.state)
        if i % LET_GO_EVERY == 0:
            let_go(aside)
    state = tuple(states)
    filtered = FilteredExtrinsics(values.copy(), covariance + _bends(results), state)
    for first, last in _stretches(states, joined):
        backwards = _backwards(aside[first : last + 1])
        for i, (x, P) in zip(range(last, first - 1, -1), backwards, strict=True):
            values[i] = seen(x)
            covariance[i] = measured_covariance(P) + persistent[i]
    bends = _bends(settled(results, config.consistency, config.region))
    return FilteredDrive(filtered, FilteredExtrinsics(values, covariance + bends, state))


def measurements(
    results: Sequence[FrameResult], tracks: PackedTracks, config: PipelineConfig
) -> list[tuple[Look, ...]]:
    """What the filter is given: the looks at the road of each frame, the pair's own first; none without a road."""
    looks: list[tuple[Look, ...]] = []
    for result in results:
        e = None if result.road is None else result.road.extrinsics
        values = None if e is None else np.array([e.height_m, e.pitch_rad, e.roll_rad])
        looks.append(() if values is None or result.road is None else (Look(values, result.road.covariance),))
    if config.method == "paper":
        points = zip(*road_planes(results, tracks, config.filter.road_points, config.direct), strict=True)
        looks = [(*own, Look(*other)) if own else () for own, other in zip(looks, points, strict=True)]
    return looks


def _bends(results: Sequence[FrameResult]) -> Array:
    """(N, 3, 3) what bend ahead and crossfall add to each frame, through a gap that of the frame before it.

    The filter follows the nearer road as each pair does; that the lane as a whole lies otherwise is no noise.
    """
    added, last = np.zeros((len(results), 3, 3)), np.zeros((3, 3))
    for i, result in enumerate(results):
        last = last if result.road is None else result.road.bend_covariance
        added[i] = last
    return added


def _stretches(states: Sequence[str], joined: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last of every run of updated frames over which the filter did not begin anew."""
    found: list[tuple[int, int]] = []
    for i, state in enumerate(states):
        if state != "updated":
            continue
        if found and found[-1][1] == i - 1 and joined[i]:
            found[-1] = (found[-1][0], i)
        else:
            found.append((i, i))
    return found


def _backwards(aside: Array) -> Iterator[tuple[Array, Array]]:
    """Smoothed states and covariances of consecutive frames, last frame first; (K, PACKED) of each."""
    from stereocalib_core.back.rig.body_filter import unpacked

    last = unpacked(aside[-1])
    x, P = last.x, last.P
    yield x, P
    for i in range(len(aside) - 1, 0, -1):
        later = unpacked(aside[i])
        gain = np.linalg.solve(later.P_prior, later.F @ later.P_before).T
        x = later.x_before + gain @ (x - later.x_prior)
        P = later.P_before + gain @ (P - later.P_prior) @ gain.T
        yield x, P
        if i % LET_GO_EVERY == 0:
            let_go(aside)
