"""All six between LiDAR and camera along a drive: stretch by stretch, and where one of them has slipped.

A stretch of `stretch_scans` is aligned every `hop_scans`. Where the stretch before some scan and the one after it
disagree by more than both sigmas allow, something has slipped: the axes that explain the difference best are taken
one by one, the scan at which it happened is the one at which the edges change over from one alignment to the other,
and the size is that between as much as there is before and after.

The road fixes height, pitch and roll of the LiDAR frame by frame, and `road_check` watches those; here they only take
part, so that no slip of theirs is put down to yaw, x or z.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stereocalib_core.back.lidar.alignment import Alignment, Belief, Scan, align, edge_gains
from stereocalib_core.back.lidar.residual_transform import AXES, IS_ANGLE
from stereocalib_core.config import LidarAlignmentConfig
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array


@dataclass(frozen=True)
class Slip:
    """One change: at: index of the first scan after it. size, sigma [m or rad] of axis `axis` (index into `AXES`).

    seen_by: index of the scan by which it was certain.
    """

    at: int
    axis: int
    size: float
    sigma: float
    seen_by: int

    @property
    def name(self) -> str:
        """Its axis."""
        return AXES[self.axis]


class Follower:
    """The scans of a drive and every alignment of a part of them that was asked for, each made once."""

    def __init__(
        self, scans: Sequence[Scan], camera: StereoCamera, config: LidarAlignmentConfig, belief: Belief
    ) -> None:
        self.scans, self.camera, self.config, self.belief = scans, camera, config, belief
        self._made: dict[tuple[int, int, int], Alignment] = {}

    def part(self, first: int, last: int, most: int | None = None) -> Alignment:
        """Scans first ... last - 1, aligned; at most `most` of them, evenly chosen."""
        step = 1 if most is None else max(-(-(last - first) // most), 1)
        key = (first, last, step)
        if key not in self._made:
            # near by is what was found last, if anything was
            start = next(reversed(self._made.values())).unknowns if self._made else None
            chosen = self.scans[first:last:step]
            some = align(chosen, self.camera, self.config, self.belief, start)
            if start is not None and some.worth < self.config.lost_share * self._usual():
                # what was near is no longer: look far around, and believe whatever matches better
                afresh = align(chosen, self.camera, self.config, self.belief)
                some = max(some, afresh, key=lambda a: a.worth)
            self._made[key] = replace(some, last=self.scans[last - 1].frame)
        return self._made[key]

    def _usual(self) -> float:
        return float(np.median([made.worth for made in self._made.values()]))

    def whole(self, first: int, last: int) -> Alignment:
        """A long part, by as many of its scans as say all that there is to say."""
        return self.part(first, last, self.config.most_scans)

    def halves(self) -> list[Alignment]:
        """The odd and the even scans of the drive, each for themselves."""
        start = self.whole(0, len(self.scans)).unknowns
        return [align(self.scans[k::2], self.camera, self.config, self.belief, start) for k in (0, 1)]


def find_slips(follower: Follower) -> list[Slip]:
    """Every slip of the drive, in order."""
    config = follower.config
    slips: list[Slip] = []
    parts = [(0, len(follower.scans))]
    while parts and len(slips) < config.most_slips:
        first, last = parts.pop()
        found = _surest(follower, first, last)
        if found:
            slips += found
            parts += [(first, found[0].at), (found[0].at, last)]
    return sorted(slips, key=lambda slip: (slip.at, slip.axis))


def _surest(follower: Follower, first: int, last: int) -> list[Slip]:
    """The slips at the one scan of first ... last at which before and after disagree most; one for each axis."""
    config = follower.config
    best, at = 0.0, -1
    places = range(first + config.least_scans, last - config.least_scans + 1)
    for place in [p for p in places if p % config.hop_scans == 0]:
        before = follower.part(max(place - config.stretch_scans, first), place)
        after = follower.part(place, min(place + config.stretch_scans, last))
        found = explained(before, after, config)
        surety = sum((size / sigma) ** 2 for _, size, sigma in found)
        if surety > best:
            best, at = surety, place
    if at < 0:
        return []
    for _ in range(2):
        low, high = max(at - config.stretch_scans, first), min(at + config.stretch_scans, last)
        at = _onset(follower, at, low, high)
        at = min(max(at, first + config.least_scans), last - config.least_scans)
    before, after = follower.whole(first, at), follower.whole(at, last)
    found = explained(before, after, config)
    return [
        Slip(at, axis, size, sigma, _seen_by(follower, first, at, last, axis)) for axis, size, sigma in found
    ]


def _onset(follower: Follower, near: int, low: int, high: int) -> int:
    """The first scan that the alignment after `near` explains better, by the edges of the scans low ... high - 1."""
    config = follower.config
    margin = min(config.hop_scans, (near - low) // 2, (high - near) // 2)
    gains = []
    for part in (follower.part(low, near - margin), follower.part(near + margin, high)):
        tried = _gains(follower, low, high, part)
        gains.append(tried)
    # a scan's edges are the same things again and again, so the whole course decides, not one scan
    lead = np.concatenate([[0.0], np.cumsum(gains[0] - gains[1])])
    inner = lead[1:-1]
    return low + 1 + int(np.argmax(inner)) if len(inner) else near


def _gains(follower: Follower, low: int, high: int, alignment: Alignment) -> Array:
    """(high - low,) log likelihood of the edges of each scan as another part is aligned."""
    return edge_gains(follower.scans[low:high], follower.camera, alignment.unknowns, follower.config)


def _seen_by(follower: Follower, first: int, at: int, last: int, axis: int) -> int:
    """The last scan of the shortest stretch after `at` that shows the slip along `axis` for certain."""
    config = follower.config
    before = follower.part(max(at - config.stretch_scans, first), at)
    for count in range(config.least_scans, config.stretch_scans + 1, config.least_scans // 2):
        stop = min(at + count, last)
        if axis in [a for a, _, _ in explained(before, follower.part(at, stop), config)]:
            return stop - 1
    return min(at + config.stretch_scans, last) - 1


def explained(
    before: Alignment, after: Alignment, config: LidarAlignmentConfig
) -> list[tuple[int, float, float]]:
    """Axis, size and sigma of the fewest changes that explain how `after` differs from `before`.

    Axes join one by one, that which explains most of what is left first, as long as the whole set stays certain.
    """
    difference = after.six - before.six
    information = np.linalg.inv(before.covariance + after.covariance)
    least = np.where(IS_ANGLE, np.deg2rad(config.least_slip_deg), config.least_slip_m)
    chosen: list[int] = []
    found: list[tuple[int, float, float]] = []
    while len(chosen) < len(AXES):
        tries = []
        for axis in (axis for axis in range(len(AXES)) if axis not in chosen):
            tried = [*chosen, axis]
            H, g = information[np.ix_(tried, tried)], information[tried] @ difference
            size, sigma = np.linalg.solve(H, g), np.sqrt(np.diag(np.linalg.inv(H)))
            if np.all(np.abs(size) > least[tried]) and np.all(np.abs(size) > config.slip_sigmas * sigma):
                tries.append((float(g @ size), tried, size, sigma))
        if not tries:
            break
        gain, tried, size, sigma = max(tries, key=lambda t: t[0])
        gained = gain - sum((s / d) ** 2 for _, s, d in found)
        if found and gained < config.slip_sigmas**2:
            break
        chosen = tried
        found = [(axis, float(s), float(d)) for axis, s, d in zip(tried, size, sigma, strict=True)]
    return found


def stretches(follower: Follower, slips: Sequence[Slip]) -> list[Alignment]:
    """The drive in stretches that do not overlap and over which nothing slips; what is short of one is left out."""
    config = follower.config
    ends = [0, *sorted({slip.at for slip in slips}), len(follower.scans)]
    found = []
    for first, last in zip(ends[:-1], ends[1:], strict=True):
        count = max((last - first) // config.stretch_scans, 1)
        edges = [first + (last - first) * k // count for k in range(count + 1)]
        found += [follower.part(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True) if b > a]
    return found
