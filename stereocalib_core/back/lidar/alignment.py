"""Where the LiDAR stands against the camera, all six, from a stretch of a drive: edges, surfaces and the road.

Edges first. Each edge of the scan is matched softly to the picture edges of its own side, disparity and row, and the
six are what brings them together along the rows (expectation-maximisation with Gauss-Newton steps; the Gauss curve
that matches narrows from coarse to fine, so that no start has to be near). Once they are together, the disparity of
surfaces joins. The road's own residuals, one each frame, are there from the beginning: they hold roll, pitch and
height, which edges along rows hardly show.

What else moves edges and disparities is estimated along with the six and thrown away: that the scan shows things
wider or narrower than the picture does (the width of a beam, the matcher's window), how the LiDAR turned while the
car moved, where the recording does not say, and an offset and a scale of the measured disparity.

Sigma comes from how different things disagree, not from how many edges there are: all that lies within one square of
the ground is one thing, in whichever scans it is seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from stereocalib_core.back.lidar.edge_kernels import OFFSET, SWEEP, UNKNOWNS, match_edges, match_surfaces
from stereocalib_core.back.lidar.residual_transform import IS_ANGLE, YAW, moved, shown_by_road
from stereocalib_core.config import LidarAlignmentConfig
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.results import FrameResult, Measured

SWEEPS = (-1.0, 0.0, 1.0)
"""What a LiDAR does while the car moves: turn clockwise, stand for one moment, turn counter-clockwise."""


@dataclass(frozen=True)
class Scan:
    """One scan, ready to be compared. Arrays as in `ScanSample`.

    pose: (4, 4) T_world_camera. motion: (6,) turn [rad/s] and speed [m/s] of the camera in its own axes.
    period_s: between scans. sweep: turns in that time, NaN = not known.
    road: (3,) residual, (3, 3) information, (3, 6) derivative; or None.
    """

    frame: int
    beams: Array
    edges: Array
    points: Array
    patches: Array
    T_camera_lidar: Array
    pose: Array
    motion: Array
    period_s: float
    sweep: float
    road: tuple[Array, Array, Array] | None


@dataclass(frozen=True)
class Alignment:
    """What a stretch says. six: (6,) as in `residual_transform`; covariance: (6, 6).

    nuisance: (4,) edge [px], sweep, offset [px], scale; nuisance_sigma likewise.
    beams: beam edges in all; matched: how many found their like; things: of how many things.
    gain: (N,) log likelihood of the edges of each scan over that of no match.
    """

    first: int
    last: int
    six: Array
    covariance: Array
    nuisance: Array
    nuisance_sigma: Array
    beams: int
    matched: float
    things: int
    gain: Array

    @property
    def sigma(self) -> Array:
        """(6,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def worth(self) -> float:
        """How well a beam edge matches, on average."""
        return float(self.gain.sum()) / max(self.beams, 1)

    @property
    def unknowns(self) -> Array:
        """(10,) six and nuisance, a start for a stretch near by."""
        return np.concatenate([self.six, self.nuisance])


def scans_of(
    results: Sequence[FrameResult], camera: StereoCamera, poses: Array, config: LidarAlignmentConfig
) -> list[Scan]:
    """The frames that have a scan and a place on the path. poses: (N, 4, 4) T_world_camera of all frames."""
    times = np.array([r.timestamp_s for r in results])
    steps = np.diff(times)
    period = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.1
    found = []
    for row, result in enumerate(results):
        sample = result.scan
        motion = _motion(poses, times, row)
        if sample is None or not (np.isfinite(motion).all() and np.isfinite(poses[row]).all()):
            continue
        road = None
        if result.lidar is not None and result.road is not None:
            # neighbours share their error, so each counts for less
            information = np.asarray(np.linalg.inv(result.lidar.covariance * config.correlated_frames))
            normal = result.road.extrinsics.plane().normal
            road = (result.lidar.values, information, shown_by_road(normal, sample.T_camera_lidar))
        found.append(
            Scan(
                result.frame,
                np.ascontiguousarray(sample.beam_edges),
                np.ascontiguousarray(sample.picture_edges),
                np.ascontiguousarray(sample.points),
                np.ascontiguousarray(sample.patches),
                sample.T_camera_lidar,
                poses[row],
                motion,
                period,
                sample.sweep,
                road,
            )
        )
    return found


def _motion(poses: Array, times: Array, row: int) -> Array:
    """(6,) turn [rad/s] and speed [m/s] of the camera at a frame, in its own axes, from the frames beside it."""
    before, after = max(row - 1, 0), min(row + 1, len(poses) - 1)
    elapsed = times[after] - times[before]
    if not elapsed > 0:
        return np.zeros(6)
    R = poses[before, :3, :3].T @ poses[after, :3, :3]
    turn = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    way = poses[row, :3, :3].T @ (poses[after, :3, 3] - poses[before, :3, 3])
    return np.concatenate([turn, way]) / elapsed


@dataclass(frozen=True)
class Belief:
    """What is thought of the ten unknowns before a stretch is looked at: (10,) mean and sigma."""

    mean: Array
    sigma: Array

    @classmethod
    def of(cls, config: LidarAlignmentConfig, sweep: float = 0.0, sweep_sigma: float = 1.0) -> Belief:
        """The LiDAR about where it was calibrated to be."""
        mean = np.zeros(UNKNOWNS)
        mean[SWEEP] = sweep
        six = np.where(IS_ANGLE, np.deg2rad(config.prior_angle_deg), config.prior_length_m)
        others = [config.prior_edge_px, sweep_sigma, config.prior_offset_px, config.prior_scale]
        return cls(mean, np.concatenate([six, others]))

    def with_offset(self, offset_px: Measured, config: LidarAlignmentConfig) -> Belief:
        """The same with the disparity offset that the motion of the car shows, to be added to measured disparities."""
        mean, sigma = self.mean.copy(), self.sigma.copy()
        mean[OFFSET] = -offset_px.value
        sigma[OFFSET] = np.hypot(offset_px.sigma, config.matcher_bias_px)
        return Belief(mean, sigma)


@dataclass
class _Sums:
    """Normal equations of a stretch at one place of the unknowns."""

    gain: Array
    H: Array = field(default_factory=lambda: np.zeros((UNKNOWNS, UNKNOWNS)))
    g: Array = field(default_factory=lambda: np.zeros(UNKNOWNS))
    curvature: Array = field(default_factory=lambda: np.zeros((UNKNOWNS, UNKNOWNS)))
    matched: float = 0.0
    scores: list[Array] = field(default_factory=list)
    places: list[Array] = field(default_factory=list)


def _sum(
    stretch: Sequence[Scan], camera: StereoCamera, unknowns: Array, width: float, config: LidarAlignmentConfig
) -> _Sums:
    """All edges of a stretch at these unknowns, near the end its surfaces too."""
    sums = _Sums(np.zeros(len(stretch)))
    lens = (
        *(float(camera.width), float(camera.height), camera.focal_px, camera.cx_px, camera.cy_px),
        camera.focal_px * camera.baseline_m,
    )
    tolerance = (config.row_tolerance_px, config.disparity_tolerance_px, config.disparity_tolerance_share)
    for n, scan in enumerate(stretch):
        T = moved(scan.T_camera_lidar, unknowns[:6])
        placed = (np.ascontiguousarray(T[:3, :3]), np.ascontiguousarray(T[:3, 3]))
        where = (*placed, scan.motion, scan.period_s, unknowns[6:])
        scores, places = np.empty((len(scan.beams), UNKNOWNS)), np.empty((len(scan.beams), 3))
        sums.gain[n], matched = match_edges(
            scan.beams, scan.edges, lens, *where, width, tolerance, config.half_contrast, config.background,
            sums.H, sums.g, sums.curvature, scores, places,
        )  # fmt: skip
        sums.matched += matched
        sums.scores.append(scores)
        sums.places.append(places @ scan.pose[:3, :3].T + scan.pose[:3, 3])
        if width > config.surfaces_from_px:
            continue
        H = np.zeros((UNKNOWNS, UNKNOWNS))
        scores, places = np.empty((len(scan.points), UNKNOWNS)), np.empty((len(scan.points), 3))
        match_surfaces(
            scan.points, scan.patches, lens, *where, config.patch_half_px, config.surface_sigma_px,
            config.surface_most_px, H, sums.g, scores, places,
        )  # fmt: skip
        sums.H += H
        sums.curvature += H
        sums.scores.append(scores)
        sums.places.append(places @ scan.pose[:3, :3].T + scan.pose[:3, 3])
    return sums


def _known(stretch: Sequence[Scan], unknowns: Array, belief: Belief) -> tuple[Array, Array]:
    """(U, U) and (U,) of what the road and the belief add to the normal equations."""
    H, g = np.diag(belief.sigma**-2.0), (belief.mean - unknowns) / belief.sigma**2
    for scan in stretch:
        if scan.road is not None:
            values, information, J = scan.road
            H[:6, :6] += J.T @ information @ J
            g[:6] += J.T @ information @ (values - J @ unknowns[:6])
    return H, g


def align(
    stretch: Sequence[Scan],
    camera: StereoCamera,
    config: LidarAlignmentConfig,
    belief: Belief,
    start: Array | None = None,
) -> Alignment:
    """The six of a stretch of scans. start: (10,) unknowns near by; None = look for them."""
    unknowns = _search(stretch, camera, config, belief) if start is None else start.copy()
    widths = config.widths_px if start is None else config.widths_px[-config.near_widths :]
    for width in widths:
        for _ in range(config.rounds):
            sums = _sum(stretch, camera, unknowns, width, config)
            H, g = _known(stretch, unknowns, belief)
            unknowns = unknowns + np.linalg.solve(H + sums.H, g + sums.g)
    sums = _sum(stretch, camera, unknowns, widths[-1], config)
    H, _ = _known(stretch, unknowns, belief)
    spread, things = _spread(sums, config)
    inverse = np.linalg.inv(H + _at_least(sums.curvature, sums.H))
    covariance = inverse @ (H + spread) @ inverse
    angle = config.systematic_px / camera.focal_px
    floor = np.where(IS_ANGLE, angle, angle * config.systematic_range_m)
    covariance[:6, :6] += np.diag(floor**2)
    return Alignment(
        stretch[0].frame, stretch[-1].frame, unknowns[:6], covariance[:6, :6],
        unknowns[6:], np.sqrt(np.diag(covariance)[6:]),
        sum(len(scan.beams) for scan in stretch), sums.matched, things, sums.gain,
    )  # fmt: skip


def _at_least(curvature: Array, H: Array) -> Array:
    """The curvature, and where matches that change hands leave hardly any of it, a tenth of what fixed ones have."""
    scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
    values, vectors = np.linalg.eigh(curvature / np.outer(scale, scale))
    fixed = np.einsum("ik,ij,jk->k", vectors, H / np.outer(scale, scale), vectors)
    return np.asarray((vectors * np.maximum(values, 0.1 * fixed)) @ vectors.T * np.outer(scale, scale))


def _search(
    stretch: Sequence[Scan], camera: StereoCamera, config: LidarAlignmentConfig, belief: Belief
) -> Array:
    """(U,) the road's three and the yaw with which most edges of the scans find their like, far around."""
    H, g = _known(stretch, belief.mean, belief)
    unknowns = belief.mean + np.linalg.solve(H, g)
    few = stretch[:: max(len(stretch) // config.search_scans, 1)]
    reach = np.deg2rad(config.search_yaw_deg)
    best, found = -np.inf, unknowns
    for yaw in np.linspace(-reach, reach, config.search_steps):
        trial = unknowns.copy()
        trial[YAW] = yaw
        gain = float(_sum(few, camera, trial, config.search_width_px, config).gain.sum())
        if gain > best:
            best, found = gain, trial
    return found


def _spread(sums: _Sums, config: LidarAlignmentConfig) -> tuple[Array, int]:
    """(U, U) sum over things of the outer product of their scores, and how many things there are."""
    scores, places = np.concatenate(sums.scores), np.concatenate(sums.places)
    used = np.any(scores != 0.0, axis=1)
    if not used.any():
        return np.zeros((UNKNOWNS, UNKNOWNS)), 0
    cells = np.floor(places[used][:, [0, 2]] / config.thing_m).astype(np.int64)
    # one number a cell: numpy sorts numbers many times as fast as pairs
    cells -= cells.min(axis=0)
    _, thing = np.unique(cells[:, 0] * (cells[:, 1].max() + 1) + cells[:, 1], return_inverse=True)
    count = int(thing.max()) + 1
    total = np.stack([np.bincount(thing, scores[used, k], count) for k in range(UNKNOWNS)], axis=1)
    return total.T @ total * count / max(count - UNKNOWNS, 1), count


def sweep_belief(scans: Sequence[Scan], camera: StereoCamera, config: LidarAlignmentConfig) -> Belief:
    """How the LiDAR turns while the car moves: as the recording says and as the scans themselves fit best.

    A scan of one moment is taken at its word. Otherwise each of `SWEEPS` is tried on scans from all over the drive and
    weighs as much as its likelihood, in which the edges of one thing count as one, times what was thought of it before:
    `stated_sweep` of the sense that the recording states, the same of all where it states none. A car that stands
    tells nothing of it.
    """
    known = np.array([scan.sweep for scan in scans])
    stated = float(np.median(known)) if np.isfinite(known).all() else np.nan
    if stated == 0.0:
        return Belief.of(config, stated, config.known_sweep_sigma)
    before = np.full(len(SWEEPS), 1.0)
    if stated in SWEEPS:
        others = (1.0 - config.stated_sweep) / (len(SWEEPS) - 1.0)
        before = np.where(np.array(SWEEPS) == stated, config.stated_sweep, others)
    few = list(scans[:: max(len(scans) // config.sweep_scans, 1)])
    tried = [
        align(few, camera, config, Belief.of(config, sweep, config.known_sweep_sigma)) for sweep in SWEEPS
    ]
    once = sum(t.things for t in tried) / max(sum(t.matched for t in tried), 1.0)
    gains = np.array([t.gain.sum() for t in tried]) * once
    weights = before * np.exp(gains - gains.max())
    weights /= weights.sum()
    mean = float(weights @ SWEEPS)
    spread = float(np.sqrt(weights @ (np.array(SWEEPS) - mean) ** 2))
    return Belief.of(config, mean, max(spread, config.known_sweep_sigma))


def edge_gains(
    stretch: Sequence[Scan], camera: StereoCamera, unknowns: Array, config: LidarAlignmentConfig
) -> Array:
    """(N,) log likelihood of the edges of each scan, over that of no match, with the LiDAR where `unknowns` put it."""
    return _sum(stretch, camera, unknowns, config.widths_px[-1], config).gain


def distinct(
    stretch: Sequence[Scan],
    camera: StereoCamera,
    config: LidarAlignmentConfig,
    belief: Belief,
    found: Alignment,
) -> float:
    """How many times as well the edges match where they were found to than at the other yaws that were searched."""
    few = stretch[:: max(len(stretch) // config.search_scans, 1)]
    reach = np.deg2rad(config.search_yaw_deg)
    gains = []
    for yaw in np.linspace(-reach, reach, config.search_steps):
        trial = found.unknowns
        trial[YAW] += yaw
        gains.append(float(edge_gains(few, camera, trial, config).sum()))
    middle = len(gains) // 2
    others = [gain for k, gain in enumerate(gains) if abs(k - middle) > 2]
    return gains[middle] / max(float(np.median(others)), 1e-9)
