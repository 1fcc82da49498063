"""From one stereo pair to its road: the stages in order, and where and why they give up."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import DirectConfig, ImageConfig, LimitsConfig, PipelineConfig
from stereocalib_core.errors import Failure, FailureReason
from stereocalib_core.front.horizon import first_row, match_by_the_horizon
from stereocalib_core.front.matching import Matcher, find_matcher
from stereocalib_core.front.own_car import OwnCar
from stereocalib_core.front.road import candidates, free_map, lane, uv_disparity
from stereocalib_core.front.road.candidates import Way
from stereocalib_core.front.road.carried import NOTHING, Moved, Past
from stereocalib_core.front.road.doubt import alone, beside_the_step, crossfalls, in_doubt, leans, step_m
from stereocalib_core.front.road.notes import Notes
from stereocalib_core.front.road.paper import PaperFit, fit_on_region
from stereocalib_core.front.road.plane import DirectFit, fit_direct
from stereocalib_core.front.road.region import Region, grow
from stereocalib_core.front.road.result import RoadResult
from stereocalib_core.front.rows.self_check import overhead, upside_down_check
from stereocalib_core.front.sight import matching_step, road_disparity, widest_disparity
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.numeric.arrays import Grey
from stereocalib_core.results import OWN_CAR, DisparityMap, RoadEstimate


def look(image: Grey, config: ImageConfig) -> tuple[float, float, float]:
    """Mean grey, share of saturated pixels and mean |horizontal difference| of a sample of the lower half."""
    lower = np.ascontiguousarray(image[image.shape[0] // 2 :: 4, ::2])
    step = cv2.norm(lower[:, 1:], lower[:, :-1], cv2.NORM_L1) / lower[:, 1:].size
    return float(lower.mean()), float(np.mean(lower >= 254)), 0.5 * step


def _unusable(notes: Notes, left: Grey, right: Grey, config: ImageConfig) -> Failure | None:
    """DARK, SATURATED or FLAT_TEXTURE, by the worse of the two pictures."""
    looks = np.array([look(left, config), look(right, config)])
    mean, saturated, gradient = looks[:, 0].min(), looks[:, 1].max(), looks[:, 2].min()
    if not notes.check("image", "mean grey", mean, low=config.min_mean):
        return Failure(FailureReason.DARK, f"mean grey {mean:.1f}, needs {config.min_mean:g}")
    if not notes.check("image", "saturated share", saturated, high=config.max_saturated):
        return Failure(
            FailureReason.SATURATED, f"{saturated:.0%} saturated, at most {config.max_saturated:.0%}"
        )
    if not notes.check("image", "texture", gradient, low=config.min_gradient, unit="grey/px"):
        return Failure(
            FailureReason.FLAT_TEXTURE, f"texture {gradient:.2f} grey/px, needs {config.min_gradient:g}"
        )
    return None


def limits_failure(
    extrinsics: Extrinsics, sigma: NDArray[np.float64], limits: LimitsConfig
) -> Failure | None:
    """OUT_OF_RANGE or TOO_UNCERTAIN, or None for an estimate that may be believed."""
    e = extrinsics
    inside = (
        limits.min_height_m <= e.height_m <= limits.max_height_m
        and abs(e.pitch_rad) <= limits.max_pitch_rad
        and abs(e.roll_rad) <= limits.max_roll_rad
    )
    if not inside:
        return Failure(
            FailureReason.OUT_OF_RANGE,
            f"height {e.height_m:.2f} m, pitch {e.pitch_deg:.1f} deg, roll {e.roll_deg:.1f} deg",
        )
    highest = (limits.max_height_sigma * e.height_m, limits.max_pitch_sigma_rad, limits.max_roll_sigma_rad)
    if not np.all(sigma <= highest):
        h, p, r = sigma[0], *np.rad2deg(sigma[1:])
        return Failure(
            FailureReason.TOO_UNCERTAIN, f"sigma of height {h:.3f} m, pitch {p:.2f} deg, roll {r:.2f} deg"
        )
    return None


@dataclass(frozen=True)
class Hint:
    """Where to look, from the frames before: the road that the rig stood on, where the car goes and where it points.

    past: by the rig, as it stood over the last ones. carried: the road of the last ones themselves, seen from where the
    car is now: over a crossing road, or one that leans, it is another one.
    heading_slope: x / z of the direction of straight travel: the tangent of the mount's yaw.
    moved: how the car came here since the pair before. driven: as in `Past`. own: the own car in the picture, which is
    no road.
    """

    past: Extrinsics | None = None
    carried: Extrinsics | None = None
    way: Way = Way()
    heading_slope: float = 0.0
    moved: Moved = Moved()
    driven: bool = True
    own: OwnCar | None = None

    @property
    def before(self) -> Past:
        """The road of a moment ago, both ways."""
        return Past(self.past, self.carried, self.driven)


def _with_region(
    road: RoadResult, notes: Notes, camera: StereoCamera, config: PipelineConfig, hint: Hint
) -> RoadResult:
    """The same with the free map and the road's own region; `region` stays None where there is none."""
    disparity = road.disparity
    cells = candidates.gather(disparity, camera, hint.way, config.sight, config.region)
    plane = candidates.best_plane(
        cells, camera, disparity.step_px, hint.before, config.limits, config.sight, config.region
    )
    notes.lap("region")
    height_m = config.free_map.road_height_m if plane is None else plane.extrinsics(camera).height_m
    bin_px = config.free_map.bin_px * max(1.0, disparity.step_px / 2)
    bins = int(np.ceil(np.nanmax(disparity.values, initial=1.0) / bin_px)) + 1
    u_counts = uv_disparity.u_disparity(disparity.values, bin_px, bins)
    free_config = dataclasses.replace(config.free_map, road_height_m=1.2 * height_m)
    obstacles, free = free_map.separate(disparity, u_counts, bin_px, camera, free_config)
    none = np.zeros_like(free)
    road = dataclasses.replace(
        road, bin_px=bin_px, u_disparity=u_counts, obstacles=obstacles, free=free, road=none
    )
    notes.lap("free_map")
    if plane is None:
        return dataclasses.replace(road, failure=Failure(FailureReason.NO_ROAD, NOTHING_AHEAD))
    strips = Way(hint.heading_slope), hint.way
    region = grow(disparity, free, camera, plane, strips, config.sight, config.region)
    carried = hint.carried
    if region is not None and carried is not None:
        off_m = step_m(region, carried, camera, hint.moved, config.region)
        if off_m is not None or leans(region, carried, camera, config.region):
            start = carried.disparity_plane(camera)
            again = grow(disparity, free, camera, start, strips, config.sight, config.region)
            beside = beside_the_step(again, carried, camera, hint.moved, config.region)
            if beside is None and off_m is not None:
                return dataclasses.replace(road, failure=Failure(FailureReason.NO_ROAD, _off_the_road(off_m)))
            region = beside or region
    notes.lap("region")
    if region is None:
        few = f"no {config.region.min_cells} connected cells of road"
        return dataclasses.replace(road, failure=Failure(FailureReason.NO_ROAD, few))
    return dataclasses.replace(road, region=region)


def _match(
    match: Matcher,
    left: Grey,
    right: Grey,
    camera: StereoCamera,
    config: PipelineConfig,
    past: Extrinsics | None,
    whole: bool,
) -> DisparityMap:
    """Dense disparity as far as the nearest road in the picture: of the past, or that of a camera mounted as most are.

    Where nothing is known and the road turns out to come nearer than that, or is not seen at all, once more.
    """
    if config.disparity.max_disparity_px != "auto":
        return match(left, right, camera, config.disparity)
    margin, step = config.disparity.margin, matching_step(camera, config.disparity)
    if past is not None:
        first = 0 if whole else first_row(camera, past, step, config.sight)
        farthest = margin * road_disparity(camera, past)
        if first > 0:
            return match_by_the_horizon(match, left, right, camera, config.disparity, step, farthest, first)
        return match(left, right, camera, config.disparity, step, farthest)
    usual = Extrinsics(config.sight.guess_per_baseline * camera.baseline_m, 0.0, 0.0)
    farthest = margin * road_disparity(camera, usual)
    found = match(left, right, camera, config.disparity, step, farthest)
    nearest = _nearest(found, camera, config)
    if nearest is None:
        widest = widest_disparity(camera, config.limits, config.sight)
        nearest = _nearest(match(left, right, camera, config.disparity, 2 * step, widest), camera, config)
    if nearest is None or nearest <= farthest:
        return found
    return match(left, right, camera, config.disparity, step, margin * nearest)


def _nearest(disparity: DisparityMap, camera: StereoCamera, config: PipelineConfig) -> float | None:
    """Largest disparity [px] of the road that a map shows by itself; None: it shows none."""
    cells = candidates.gather(disparity, camera, Way(), config.sight, config.region)
    plane = candidates.best_plane(
        cells, camera, disparity.step_px, NOTHING, config.limits, config.sight, config.region
    )
    return None if plane is None else road_disparity(camera, plane.extrinsics(camera))


def begin_road(
    left: Grey,
    right: Grey,
    camera: StereoCamera,
    config: PipelineConfig,
    matcher: Matcher | None = None,
    past: Extrinsics | None = None,
    whole: bool = True,
) -> RoadResult:
    """Are the pictures usable, and their dense disparity.

    matcher: None = the one that `config` names. past: the road of a moment ago. whole: as finely above its horizon.
    """
    notes = Notes()
    failure = _unusable(notes, left, right, config.images)
    notes.lap("image")
    if failure is not None:
        return notes.end(RoadResult(), failure)
    match = matcher or find_matcher(config.disparity.matcher)
    disparity = _match(match, left, right, camera, config, past, whole)
    notes.lap("disparity")
    return notes.end(RoadResult(disparity))


def estimate_road(
    left: Grey,
    right: Grey,
    camera: StereoCamera,
    config: PipelineConfig,
    matcher: Matcher | None = None,
    hint: Hint | None = None,
) -> RoadResult:
    """(H, W) uint8 grey pair to its road by `config.method`; a pair without a road says why.

    The paper's chain is run beside it whatever the method, for whoever compares.
    """
    begun = begin_road(left, right, camera, config, matcher, None if hint is None else hint.past)
    return finish_road(begun, left, right, camera, config, hint, compare=True)


def finish_road(
    begun: RoadResult,
    left: Grey,
    right: Grey,
    camera: StereoCamera,
    config: PipelineConfig,
    hint: Hint | None = None,
    compare: bool = False,
) -> RoadResult:
    """From the dense disparity of `begin_road` to the road.

    compare: the paper's chain too, where the method is another one.
    """
    disparity = begun.matched
    if disparity is None:
        return begun
    notes, hint = Notes.of(begun), hint or Hint()
    lower = disparity.values[disparity.values.shape[0] // 2 :]
    if hint.own is not None:
        lower = lower[~hint.own.covers(disparity)[-len(lower) :]]
        disparity = hint.own.without(disparity)
        begun = dataclasses.replace(begun, disparity=disparity)
        notes.check(*OWN_CAR, hint.own.rows_px(camera.height), unit="px")
    valid = float(np.mean(lower > 0)) if lower.size else 0.0
    if not notes.check(
        "disparity", "valid share, lower half", valid, low=config.disparity.min_valid_fraction
    ):
        few = f"{valid:.0%} of the lower half has a disparity"
        return notes.end(begun, Failure(FailureReason.NO_DISPARITY, few))
    road = _with_region(begun, notes, camera, config, hint)
    region = road.region
    if region is None:
        return _no_road(notes, road, config)
    _, share = lane.road_mask(disparity, road.free, camera, region.plane.extrinsics(camera), config.lane)
    carried = hint.carried
    sure = carried is not None and step_m(region, carried, camera, hint.moved, config.region) is None
    least = config.region.least_share_carried if sure else config.region.least_share_ahead
    enough = notes.check("region", "share of the way ahead", region.share, low=least)
    notes.check("region", "on the plane", region.planar)
    if not enough:
        little = f"road on {region.share:.0%} of the way ahead, needs {least:.0%}"
        return _no_road(
            notes, dataclasses.replace(road, failure=Failure(FailureReason.NO_ROAD, little)), config
        )
    paper = direct = None
    if config.method == "paper" or compare:
        paper = fit_on_region(disparity, region, camera, config.profile)
        notes.lap("profile")
    if config.method == "direct":
        direct = fit_direct(left, right, camera, region, disparity.step_px, _scaled(config.direct, region))
        notes.lap("direct")
        found = _by_alignment(notes, direct, region, hint, config)
    else:
        found = _by_profile(paper)
    road = dataclasses.replace(road, road=region.cells, free_fraction=share, paper=paper, direct=direct)
    if isinstance(found, Failure):
        return notes.end(road, found)
    failure = _believed(notes, found, config.limits)
    if failure is not None:
        return notes.end(road, failure)
    # How well a plane is known decides; that a pair alone can't tell whose plane it is says nothing of that.
    doubt = (0.0, 0.0) if direct is None else alone(region, hint.before, config.direct)
    e, covariance, inliers, crossfall_rad, along = found
    estimate = RoadEstimate(
        *(e, covariance, inliers, share, region.range_m),
        crossfall_rad=crossfall_rad, along=along, alone=doubt,
    )  # fmt: skip
    return notes.end(road, None, estimate)


def _no_road(notes: Notes, road: RoadResult, config: PipelineConfig) -> RoadResult:
    """Ends without a road; a picture that has what is near above is told to stand on its head."""
    values = road.disparity.values
    rows, columns = np.nonzero(values > 0)
    turned = overhead(rows.astype(np.float64), values[rows, columns].astype(np.float64), values.shape[0])
    if turned > config.rectification.overhead:
        notes.checks.append(upside_down_check(turned, config.rectification))
    return notes.end(road, road.failure)


def _off_the_road(higher_m: float) -> str:
    """What is seen ahead, so much higher [m] than the road that the car came along."""
    step = f"{100 * abs(higher_m):.0f} cm {'above' if higher_m > 0 else 'below'}"
    return f"what is seen ahead lies {step} the road that the car came along: beyond a kerb, or on a hump"


NOTHING_AHEAD = "nothing in front of the car lies on one plane below it"
Found = tuple[Extrinsics, NDArray[np.float64], int, float, tuple[float, float]]
"""Extrinsics, their (3, 3) covariance, what agrees, and `crossfalls` with what is left of doubt."""


def _by_profile(fit: PaperFit | None) -> Found | Failure:
    if fit is None:
        return Failure(FailureReason.NO_ROAD, "no road profile in the v-disparity of the region")
    return fit.extrinsics, fit.covariance, fit.profile.inliers, 0.0, (0.0, 0.0)


def _by_alignment(
    notes: Notes, direct: DirectFit | None, region: Region, hint: Hint, settings: PipelineConfig
) -> Found | Failure:
    """The direct alignment over the region, with what a road must fulfil."""
    config = settings.direct
    if direct is None:
        return Failure(FailureReason.FLAT_TEXTURE, "too few patches of the road have texture")
    if not notes.check("direct", "patches on the plane", direct.agreement, low=config.min_agreement):
        return Failure(
            FailureReason.NOT_PLANAR,
            f"{direct.agreement:.0%} of the road's patches on one plane, needs {config.min_agreement:.0%}",
        )
    rough_mm, most_mm = 1e3 * direct.roughness_m, 1e3 * config.max_roughness_m
    if not notes.check("direct", "near road over the plane, rms", rough_mm, high=most_mm, unit="mm"):
        return Failure(
            FailureReason.NOT_PLANAR,
            f"the near road is {rough_mm:.0f} mm rms off its plane, at most {most_mm:.1f}",
        )
    crossfall, along = crossfalls(region, hint.way, settings)
    inliers = int(np.count_nonzero(direct.patches.weight))
    found = direct.extrinsics, direct.covariance, inliers, crossfall, along
    return _doubted(found, in_doubt(direct.extrinsics, region, hint.before, settings), region)


def _doubted(found: Found, doubt: tuple[float, float], region: Region) -> Found:
    """The same with `doubt`, 1 sigma of pitch and roll [rad], of whether it is the road at all."""
    extrinsics, covariance, inliers, crossfall, along = found
    if doubt == (0.0, 0.0):
        return found
    pitch = float(np.hypot(along[1], doubt[0]))
    along = (0.25 * sum(region.range_m) * pitch, pitch)
    return extrinsics, covariance, inliers, float(np.hypot(crossfall, doubt[1])), along


def _scaled(config: DirectConfig, region: Region) -> DirectConfig:
    """The lane that the plane is meant for, as this camera sees it: from the nearest road in the picture."""
    near_m = min(config.near_m, region.reach.near_m)
    far_m = region.reach.far_m
    return dataclasses.replace(
        config, near_m=near_m, far_m=far_m, rough_range_m=config.rough_range * region.reach.near_m
    )


def _believed(notes: Notes, found: Found, limits: LimitsConfig) -> Failure | None:
    """OUT_OF_RANGE or TOO_UNCERTAIN, and their numbers among the checks."""
    extrinsics, covariance, _, crossfall_rad, along = found
    sigma = np.sqrt(np.diag(covariance) + np.square([*along, crossfall_rad]))
    degrees = np.rad2deg(sigma)
    check = notes.check
    check("estimate", "height", extrinsics.height_m, limits.min_height_m, limits.max_height_m, "m")
    check("estimate", "height sigma", sigma[0], high=limits.max_height_sigma * extrinsics.height_m, unit="m")
    check("estimate", "pitch sigma", degrees[1], high=np.rad2deg(limits.max_pitch_sigma_rad), unit="deg")
    check("estimate", "roll sigma", degrees[2], high=np.rad2deg(limits.max_roll_sigma_rad), unit="deg")
    return limits_failure(extrinsics, sigma, limits)
