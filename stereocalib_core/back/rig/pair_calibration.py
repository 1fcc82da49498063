"""All that a drive says of its own stereo pair, put together: rows, motion, LiDAR or a known path.

Rows give relative pitch and roll (`pair`), the motion of the car the relative yaw (`relative_yaw`), something metric
the scale of depths (`depth_scale`). Where one camera was knocked on the way (`pair_changes`), the values are those
after the last knock: those of the rig as it is now.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.back.odometry.packing import PackedTracks
from stereocalib_core.back.rig.depth_scale import LidarDisparity, path_scale
from stereocalib_core.back.rig.pair import robust_mean
from stereocalib_core.back.rig.pair_by_lidar import by_lidar
from stereocalib_core.back.rig.pair_changes import Step, steps, stretches
from stereocalib_core.back.rig.relative_yaw import RelativeYaw, as_it_may_be, grouped_sigma, relative_yaw
from stereocalib_core.back.rig.stereo_tracks import StereoTracks, stereo_tracks
from stereocalib_core.back.rig.yaw_solution import YawSolution, solve_yaw
from stereocalib_core.config import PipelineConfig
from stereocalib_core.config.verdicts import REFERENCE_M, SURE
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.results import BendEffects, DepthScale, FrameResult, Measured, Pair, PairChange
from stereocalib_core.results.pair import Verdict, worst

ZERO = Measured(0.0, 0.0)


def calibrate_pair(
    camera: StereoCamera,
    results: Sequence[FrameResult],
    tracks: PackedTracks,
    rows: Pair,
    truth: Array | None,
    height_m: float | None,
    config: PipelineConfig,
    lidar_stands: bool = True,
) -> Pair:
    """The pair over a drive.

    tracks: of `results`, for where motions start. rows: what the rows say, `pair.summarise`. truth: (N, 4, 4) poses of
    a truth or a GNSS, NaN = unknown, or None. height_m: of the camera over the road, for what a bend does to it.
    lidar_stands: whether the LiDAR is where it was calibrated to be; another one gives no scale.
    """
    block, active = stereo_tracks(camera, results), np.asarray(tracks.active)
    changes, (first, last) = _changes(block, results, tracks.stereo_motion, active, rows, config)
    inside = np.zeros(len(results), dtype=bool)
    inside[first:last] = True
    if changes:
        rows = _rows_within(rows, results[first:last])
    # the pair of frames that ends in the first frame of a stretch begins before it
    moving = active & inside & np.concatenate([[False], inside[:-1]])
    roll_pitch = (rows.relative_roll_rad or ZERO, rows.relative_pitch_rad or ZERO)
    yaw = relative_yaw(block, tracks.stereo_motion, moving, roll_pitch, config.pair)
    yaw = as_it_may_be(yaw, block, _keystones(results[first:last]), config.pair)
    offset = _offset(yaw, camera)
    lidar = (
        by_lidar(camera, results, inside, tracks.stereo_motion, roll_pitch, config) if lidar_stands else None
    )
    scale = _scale(camera, yaw.solution, lidar, offset, truth, config)
    found = dataclasses.replace(
        rows,
        relative_yaw_rad=Measured(yaw.yaw_rad, yaw.sigma_rad) if yaw.measured else None,
        disparity_offset_px=offset,
        depth_scale=scale,
        pairs=yaw.pairs,
        yaw_halves=tuple(yaw.halves.tolist()) if yaw.measured else (),
        yaw_thirds=tuple(yaw.thirds.tolist()) if yaw.measured else (),
        yaw_reason=yaw.reason,
        by_lidar_px=None if lidar is None else lidar.offset,
        lidar_halves=_halves(lidar),
        changes=changes,
    )
    effects = bend_effects(camera, found, height_m, yaw.solution, tracks.stereo_motion)
    found = dataclasses.replace(found, effects=effects, yaw_mends=yaw_mends(camera, found, config))
    return dataclasses.replace(found, verdict=_verdict(found, config), why=_why(found, config))


def _keystones(results: Sequence[FrameResult]) -> Array:
    """(K,) [rad] of the frames whose rows were measured."""
    return np.array([r.rectification.keystone_rad for r in results if r.rectification is not None])


def _offset(yaw: RelativeYaw, camera: StereoCamera) -> Measured | None:
    """[px] to be added to measured disparities at the middle of the right picture."""
    if not yaw.measured:
        return None
    return Measured(float(camera.focal_px * np.tan(yaw.yaw_rad)), camera.focal_px * yaw.sigma_rad)


def _halves(lidar: LidarDisparity | None) -> tuple[tuple[float, float], ...]:
    """Offset [px] and scale by the odd and the even scans, where both give them."""
    if lidar is None or not np.isfinite(lidar.halves).all():
        return ()
    return tuple((float(offset), float(scale)) for offset, scale in lidar.halves)


def _changes(
    block: StereoTracks,
    results: Sequence[FrameResult],
    motions: Array,
    active: NDArray[np.bool_],
    rows: Pair,
    config: PipelineConfig,
) -> tuple[tuple[PairChange, ...], tuple[int, int]]:
    """Knocks within the drive, and the first row and the one after the last of the stretch after the last knock."""
    count, limits = len(results), config.rectification
    held = tuple(0.0 if m is None else m.value for m in (rows.relative_roll_rad, rows.relative_pitch_rad))
    roll_pitch = held[0], held[1]
    solution = solve_yaw(block, motions, active, roll_pitch, config.pair, by_strips=False)
    yaws, precision = np.full(count, np.nan), np.zeros(count)
    if solution is not None:
        yaws[solution.used], precision[solution.used] = solution.of_pairs, solution.curvature
    samples = [r.rectification for r in results]
    values = np.array([np.full(3, np.nan) if s is None else s.values for s in samples]).reshape(-1, 3)
    inverse = np.array([np.full(3, np.nan) if s is None else 1.0 / np.diag(s.covariance) for s in samples])
    found: list[tuple[str, Step]] = []
    seek = config.pair.steps
    suspect_yaw = np.deg2rad(config.pair.suspect_yaw_deg)
    found += [("yaw", step) for step in steps(yaws, precision, suspect_yaw, True, seek)]
    for axis, column, least in (("pitch", 1, limits.suspect_pitch_deg), ("roll", 2, limits.suspect_roll_deg)):
        looks = steps(values[:, column], inverse.reshape(-1, 3)[:, column], np.deg2rad(least), False, seek)
        found += [(axis, step) for step in looks]
    found.sort(key=lambda one: one[1].at)
    bounds = stretches(count, [step.at for _, step in found])
    yaws_of = (
        []
        if len(bounds) < 2
        else [_yaw_of(block, motions, active, roll_pitch, part, config) for part in bounds]
    )
    found = [(axis, _sized(step, bounds, yaws_of) if axis == "yaw" else step) for axis, step in found]
    changes = tuple(
        PairChange(results[step.at].frame, axis, step.size, step.sigma)  # type: ignore[arg-type]
        for axis, step in found
    )
    return changes, bounds[-1]


def _yaw_of(
    block: StereoTracks,
    motions: Array,
    active: NDArray[np.bool_],
    roll_pitch: tuple[float, float],
    part: tuple[int, int],
    config: PipelineConfig,
) -> Measured | None:
    """The yaw of a stretch by itself."""
    rows = np.arange(len(active))
    within = active & (rows > part[0]) & (rows < part[1])
    solution = solve_yaw(block, motions, within, roll_pitch, config.pair, by_strips=False)
    if solution is None:
        return None
    return Measured(solution.yaw_rad, grouped_sigma(solution, config.pair.pairs_together))


def _sized(step: Step, bounds: list[tuple[int, int]], yaws: Sequence[Measured | None]) -> Step:
    """A step of the yaw with the size that the stretches beside it give: where two states are taken for one, as
    where it was found, the points of both are taken for half wrong and the step for smaller."""
    for k in range(1, len(bounds)):
        before, after = yaws[k - 1], yaws[k]
        if bounds[k][0] == step.at and before is not None and after is not None:
            return Step(step.at, after.value - before.value, float(np.hypot(before.sigma, after.sigma)))
    return step


def _rows_within(rows: Pair, results: Sequence[FrameResult]) -> Pair:
    """The row values of a stretch alone; the verdict on them stays that of the whole drive."""
    samples = [r.rectification for r in results if r.rectification is not None]
    if not samples:
        return dataclasses.replace(rows, row_offset_px=None, relative_pitch_rad=None, relative_roll_rad=None)
    values = np.array([sample.values for sample in samples])
    sigma = np.sqrt(np.array([np.diag(sample.covariance) for sample in samples]))
    mean, error = robust_mean(values, sigma)
    offset, pitch, roll = (Measured(float(v), float(s)) for v, s in zip(mean, error, strict=True))
    return dataclasses.replace(rows, row_offset_px=offset, relative_pitch_rad=pitch, relative_roll_rad=roll)


def _scale(
    camera: StereoCamera,
    solution: YawSolution | None,
    lidar: LidarDisparity | None,
    offset: Measured | None,
    truth: Array | None,
    config: PipelineConfig,
) -> DepthScale | None:
    """The scale of depths by the LiDAR, else by the path of a truth."""
    if lidar is not None:
        by_scans = lidar.scale_given(offset)
        return DepthScale(by_scans.value, by_scans.sigma, "lidar")
    if truth is None or solution is None:
        return None
    by_path = path_scale(solution, camera.baseline_m, truth, config.pair)
    return None if by_path is None else DepthScale(by_path.value, by_path.sigma, "truth")


def bend_effects(
    camera: StereoCamera,
    pair: Pair,
    height_m: float | None,
    solution: YawSolution | None = None,
    motions: Array | None = None,
) -> BendEffects | None:
    """What the bend (and a scale by LiDAR) does to depths, road and path: read minus true.

    With a yaw the measured disparity is k d - f yaw, so that a depth Z is read as Z / (k - yaw Z / b) and the road's
    plane in disparity space (eq. 16) moves as a whole: its pitch by - yaw h / b, its height by the scale alone.
    """
    if pair.relative_yaw_rad is None:
        return None
    yaw, b = pair.relative_yaw_rad.value, camera.baseline_m
    by_lidar = pair.depth_scale is not None and pair.depth_scale.source == "lidar"
    k = pair.depth_scale.value if by_lidar and pair.depth_scale is not None else 1.0
    left = k - yaw * REFERENCE_M / b
    path = float("nan")
    if solution is not None and motions is not None and len(solution.used):
        true = np.linalg.norm(solution.motions[solution.used, 3:], axis=1).sum() * b * k
        path = float(np.linalg.norm(motions[solution.used, 3:6], axis=1).sum() / true - 1.0)
    tilt = float("nan") if height_m is None else float(-yaw * height_m / b)
    return BendEffects(float(1.0 / left - 1.0) if left > 0 else float("inf"), tilt, 1.0 / k - 1.0, path)


def yaw_mends(camera: StereoCamera, pair: Pair, config: PipelineConfig) -> bool:
    """Whether mending the yaw is sure to make depths better.

    A yaw takes b / Z yaw from every depth's share, a scale the same share of all: at one distance they undo each other,
    and a calibration by targets leaves them so. Where a LiDAR gives the scale, both are mended, and the yaw needs to
    be sure by itself. Where nothing metric does, mending the yaw alone takes away half of a pair that belongs together,
    unless it is larger than any scale explains.
    """
    yaw, limits = pair.relative_yaw_rad, config.pair
    if yaw is None:
        return False
    hidden = limits.unknown_scale * camera.baseline_m / limits.scale_range_m
    if pair.depth_scale is not None and pair.depth_scale.source == "lidar":
        hidden = 0.0
    return abs(yaw.value) > SURE * float(np.hypot(yaw.sigma, hidden))


def _verdict(pair: Pair, config: PipelineConfig) -> Verdict:
    """The worst of rows and yaw; never good while the yaw is not known well enough to say so.

    Rows that too few frames show are no suspicion.
    """
    unseen = pair.rows_verdict == "suspect" and pair.row_offset_px is None
    rows: Verdict = "not measured" if unseen else pair.rows_verdict
    return worst(rows, _yaw_verdict(pair.relative_yaw_rad, config))


def _yaw_verdict(yaw: Measured | None, config: PipelineConfig) -> Verdict:
    limits = config.pair
    if yaw is None:
        return "not measured"
    size, sigma = abs(np.rad2deg(yaw.value)), np.rad2deg(yaw.sigma)
    if sigma > 0.5 * limits.suspect_yaw_deg and size < 2.0 * sigma:
        return "not measured"
    if size >= limits.bad_yaw_deg:
        return "bad"
    # at the limit sigma decides, up to a tenth: a pair bent by just so much is not good for half of the drives
    if size + min(SURE * sigma, 0.1 * limits.suspect_yaw_deg) >= limits.suspect_yaw_deg:
        return "suspect"
    return "good" if sigma <= 0.5 * limits.suspect_yaw_deg else "not measured"


def _why(pair: Pair, config: PipelineConfig) -> str:
    """One line: the yaw with what it does, knocks, the scale, and the rows."""
    parts = [_why_yaw(pair, config)]
    for change in pair.changes:
        size, sigma = np.rad2deg([change.size_rad, change.sigma_rad])
        parts.append(
            f"one camera was knocked at frame {change.frame}: relative {change.axis} changed by {size:+.3f} +- "
            f"{sigma:.3f} deg, the values are those after it"
        )
    if pair.depth_scale is not None:
        scale = pair.depth_scale
        whom = "the LiDAR" if scale.source == "lidar" else "the known path"
        share, sigma = 100.0 * (scale.value - 1.0), 100.0 * scale.sigma
        parts.append(f"by {whom} depths are to be scaled by {share:+.2f} +- {sigma:.2f} %")
    if pair.lidar_halves:
        offset_px, part = np.abs(np.diff(np.array(pair.lidar_halves), axis=0)[0])
        parts[-1] += (
            f" (odd and even scans differ by {offset_px:.3f} px of offset and {100 * part:.2f} % of scale)"
        )
    return "; ".join([*parts, pair.rows_why])


def _why_yaw(pair: Pair, config: PipelineConfig) -> str:
    yaw = pair.relative_yaw_rad
    if yaw is None or pair.disparity_offset_px is None:
        return f"relative yaw not measured: {pair.yaw_reason}"
    value, sigma = np.rad2deg([yaw.value, yaw.sigma])
    text = (
        f"relative yaw {value:+.4f} +- {sigma:.4f} deg (good up to {config.pair.suspect_yaw_deg:g}), "
        f"{pair.disparity_offset_px.value:+.2f} +- {pair.disparity_offset_px.sigma:.2f} px of disparity, by "
        f"{pair.pairs} pairs of frames"
    )
    verdict = _yaw_verdict(yaw, config)
    if verdict == "not measured":
        return f"{text}: too unsure to call it good"
    if verdict == "good" or pair.effects is None:
        return text
    if not pair.yaw_mends:
        share = 100.0 * config.pair.unknown_scale
        text += f" (told, not mended: a scale of depth of {share:g} %, which only a LiDAR would show, may undo it)"
    return f"{text}: {effects_in_words(pair.effects)}"


def effects_in_words(effects: BendEffects) -> str:
    """`depth at 30 m reads 6.0 % short, the road's pitch 0.16 deg low, the path 2.0 % short`."""
    way = "long" if effects.depth_share > 0 else "short"
    parts = [f"depth at {REFERENCE_M:g} m reads {100 * abs(effects.depth_share):.1f} % {way}"]
    if np.isfinite(effects.pitch_rad):
        way = "high" if effects.pitch_rad > 0 else "low"
        parts.append(f"the road's pitch {np.rad2deg(abs(effects.pitch_rad)):.2f} deg {way}")
    if np.isfinite(effects.path_share):
        way = "long" if effects.path_share > 0 else "short"
        parts.append(f"the path {100 * abs(effects.path_share):.1f} % {way}")
    return ", ".join(parts)
