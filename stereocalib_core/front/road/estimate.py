"""From one stereo pair to its road: the stages in order, and where and why they give up."""

from __future__ import annotations

import dataclasses
import time
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import ImageConfig, LimitsConfig, PipelineConfig
from stereocalib_core.errors import Failure, FailureReason
from stereocalib_core.front.matching import Matcher, find_matcher
from stereocalib_core.front.road import free_map, lane, uv_disparity
from stereocalib_core.front.road.lane import LaneSupport
from stereocalib_core.front.road.paper import PaperFit, fit_paper
from stereocalib_core.front.road.plane import DirectFit, fit_direct
from stereocalib_core.front.road.stages import DisparityMap
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.numeric.arrays import Grey, Mask
from stereocalib_core.results import Check, RoadEstimate


@dataclass(frozen=True)
class RoadResult:
    """Everything that one pair gave; `estimate` is None exactly when `failure` is not.

    Stages that were not reached are None. `timing_ms` names the stages that ran.
    """

    estimate: RoadEstimate | None
    failure: Failure | None
    disparity: DisparityMap | None
    u_counts: NDArray[np.int32] | None
    obstacles: Mask | None
    free: Mask | None
    road: Mask | None
    paper: PaperFit | None
    direct: DirectFit | None
    free_fraction: float | None
    checks: tuple[Check, ...]
    timing_ms: dict[str, float]


@dataclass
class RoadAttempt:
    """What has been found so far of one pair: begun by `begin_road`, ended by `finish_road`."""

    disparity: DisparityMap | None = None
    u_counts: NDArray[np.int32] | None = None
    obstacles: Mask | None = None
    free: Mask | None = None
    road: Mask | None = None
    paper: PaperFit | None = None
    direct: DirectFit | None = None
    free_fraction: float | None = None
    failure: Failure | None = None
    checks: list[Check] = field(default_factory=list)
    timing_ms: dict[str, float] = field(default_factory=dict)
    _mark: float = field(default_factory=time.perf_counter)

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

    def failed(self, reason: FailureReason, detail: str) -> RoadResult:
        """The end without a road."""
        return self.result(None, Failure(reason, detail))

    def result(self, estimate: RoadEstimate | None, failure: Failure | None) -> RoadResult:
        """The end: an estimate or why there is none."""
        return RoadResult(
            estimate, failure, self.disparity, self.u_counts, self.obstacles, self.free, self.road,
            self.paper, self.direct, self.free_fraction, tuple(self.checks), self.timing_ms,
        )  # fmt: skip


def look(image: Grey, config: ImageConfig) -> tuple[float, float, float]:
    """Mean grey, share of saturated pixels and mean |horizontal difference| of a sample of the lower half."""
    lower = np.ascontiguousarray(image[image.shape[0] // 2 :: 4, ::2])
    step = cv2.norm(lower[:, 1:], lower[:, :-1], cv2.NORM_L1) / lower[:, 1:].size
    return float(lower.mean()), float(np.mean(lower >= 254)), 0.5 * step


def _unusable(attempt: RoadAttempt, left: Grey, right: Grey, config: ImageConfig) -> Failure | None:
    """DARK, SATURATED or FLAT_TEXTURE, by the worse of the two pictures."""
    looks = np.array([look(left, config), look(right, config)])
    mean, saturated, gradient = looks[:, 0].min(), looks[:, 1].max(), looks[:, 2].min()
    if not attempt.check("image", "mean grey", mean, low=config.min_mean):
        return Failure(FailureReason.DARK, f"mean grey {mean:.1f}, needs {config.min_mean:g}")
    if not attempt.check("image", "saturated share", saturated, high=config.max_saturated):
        return Failure(
            FailureReason.SATURATED, f"{saturated:.0%} saturated, at most {config.max_saturated:.0%}"
        )
    if not attempt.check("image", "texture", gradient, low=config.min_gradient, unit="grey/px"):
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
    highest = (limits.max_height_sigma_m, limits.max_pitch_sigma_rad, limits.max_roll_sigma_rad)
    if not np.all(sigma <= highest):
        h, p, r = sigma[0], *np.rad2deg(sigma[1:])
        return Failure(
            FailureReason.TOO_UNCERTAIN, f"sigma of height {h:.3f} m, pitch {p:.2f} deg, roll {r:.2f} deg"
        )
    return None


def _paper_on_lane(
    attempt: RoadAttempt, disparity: DisparityMap, free: Mask, camera: StereoCamera, config: PipelineConfig
) -> tuple[PaperFit, LaneSupport, float] | Failure:
    """The paper's fit with its support; where the road bends away, that of the nearer part. The last is how far [m]."""
    limits = config.lane
    fit = fit_paper(disparity, free, camera, config.profile)
    if fit is None:
        return Failure(FailureReason.NO_ROAD, "no road profile in the v-disparity of the free map")
    attempt.paper = fit
    if not attempt.check(
        "profile", "share on the profile", fit.profile.support, low=config.profile.min_support
    ):
        return Failure(
            FailureReason.NO_ROAD,
            f"{fit.profile.support:.0%} of the free cells ahead on one profile, needs {config.profile.min_support:.0%}",
        )
    # A plane outside the limits has no lane to count.
    out_of_range = limits_failure(fit.extrinsics, np.zeros(3), config.limits)
    support = lane.measure(disparity, free, camera, fit.extrinsics, limits.far_m, limits)
    far_m = limits.far_m
    if out_of_range is not None or support.agreement < limits.min_agreement:
        d_near = camera.focal_px * camera.baseline_m / limits.near_only_m
        near_fit = fit_paper(
            disparity, free, camera, dataclasses.replace(config.profile, min_disparity_px=d_near)
        )
        if near_fit is not None and limits_failure(near_fit.extrinsics, np.zeros(3), config.limits) is None:
            near = lane.measure(disparity, free, camera, near_fit.extrinsics, limits.near_only_m, limits)
            if near.agreement >= limits.min_agreement_near:
                fit, support, far_m, out_of_range = near_fit, near, limits.near_only_m, None
    attempt.paper = fit
    if out_of_range is not None:
        return out_of_range
    needed = limits.min_agreement if far_m == limits.far_m else limits.min_agreement_near
    covered = attempt.check("lane", "free share of the lane", support.covered, low=limits.min_covered)
    planar = attempt.check("lane", "lane on the plane", support.agreement, low=needed)
    enough = attempt.check("lane", "agreeing cells", support.agreeing, low=limits.min_agreeing_cells)
    if not covered:
        return Failure(FailureReason.NO_ROAD, f"only {support.covered:.0%} of the lane is free")
    if not planar:
        return Failure(
            FailureReason.NOT_PLANAR,
            f"{support.agreement:.0%} of the free lane on one plane, needs {needed:.0%}",
        )
    if not enough:
        return Failure(
            FailureReason.NO_ROAD, f"{support.agreeing} cells of road, needs {limits.min_agreeing_cells}"
        )
    return fit, support, far_m


def begin_road(
    left: Grey, right: Grey, camera: StereoCamera, config: PipelineConfig, matcher: Matcher | None = None
) -> RoadAttempt:
    """The stages that keep every core busy: are the pictures usable, and their dense disparity.

    matcher: None = the one that `config` names.
    """
    attempt = RoadAttempt()
    attempt.failure = _unusable(attempt, left, right, config.images)
    attempt.lap("image")
    if attempt.failure is None:
        match = matcher or find_matcher(config.disparity.matcher)
        attempt.disparity = match(left, right, camera, config.disparity)
        attempt.lap("disparity")
    return attempt


def estimate_road(
    left: Grey, right: Grey, camera: StereoCamera, config: PipelineConfig, matcher: Matcher | None = None
) -> RoadResult:
    """(H, W) uint8 grey pair to its road by `config.method`; a pair without a road says why."""
    return finish_road(begin_road(left, right, camera, config, matcher), left, right, camera, config)


def finish_road(
    attempt: RoadAttempt, left: Grey, right: Grey, camera: StereoCamera, config: PipelineConfig
) -> RoadResult:
    """From the dense disparity of `begin_road` to the road; these stages take little more than one core."""
    disparity = attempt.disparity
    if disparity is None:
        return attempt.result(None, attempt.failure)
    lower = disparity.values[disparity.values.shape[0] // 2 :]
    valid = float(np.mean(lower > 0))
    if not attempt.check(
        "disparity", "valid share, lower half", valid, low=config.disparity.min_valid_fraction
    ):
        return attempt.failed(FailureReason.NO_DISPARITY, f"{valid:.0%} of the lower half has a disparity")

    bin_px = config.free_map.bin_px
    bins = int(np.ceil(config.disparity.max_disparity_px / bin_px))
    u_counts = uv_disparity.u_disparity(disparity.values, bin_px, bins)
    obstacles, free = free_map.separate(disparity, u_counts, bin_px, camera, config.free_map)
    attempt.u_counts, attempt.obstacles, attempt.free = u_counts, obstacles, free
    attempt.lap("free_map")

    found = _paper_on_lane(attempt, disparity, free, camera, config)
    attempt.lap("profile")
    if isinstance(found, Failure):
        return attempt.result(None, found)
    fit, support, far_m = found
    extrinsics, covariance, inliers = fit.extrinsics, fit.covariance, fit.profile.inliers
    road, free_fraction = lane.road_mask(disparity, free, camera, extrinsics, config.lane)
    attempt.road, attempt.free_fraction = road, free_fraction

    if config.method == "direct":
        reach_m = min(config.direct.far_m, far_m)
        direct = fit_direct(left, right, camera, extrinsics, road, disparity.step_px, reach_m, config.direct)
        attempt.direct = direct
        attempt.lap("direct")
        if direct is None:
            return attempt.failed(FailureReason.FLAT_TEXTURE, "too few patches of the lane have texture")
        if not attempt.check(
            "direct", "patches on the plane", direct.agreement, low=config.direct.min_agreement
        ):
            return attempt.failed(
                FailureReason.NOT_PLANAR,
                f"{direct.agreement:.0%} of the lane's patches on one plane, needs {config.direct.min_agreement:.0%}",
            )
        rough_mm, most_mm = 1e3 * direct.roughness_m, 1e3 * config.direct.max_roughness_m
        if not attempt.check("direct", "near road over the plane, rms", rough_mm, high=most_mm, unit="mm"):
            return attempt.failed(
                FailureReason.NOT_PLANAR,
                f"the near road is {rough_mm:.0f} mm rms off its plane, at most {most_mm:.1f}",
            )
        extrinsics, covariance = direct.extrinsics, direct.covariance
        inliers = int(np.count_nonzero(direct.patches.weight))

    sigma = np.sqrt(np.diag(covariance))
    limits = config.limits
    attempt.check("estimate", "height", extrinsics.height_m, limits.min_height_m, limits.max_height_m, "m")
    attempt.check("estimate", "height sigma", sigma[0], high=limits.max_height_sigma_m, unit="m")
    attempt.check(
        "estimate",
        "pitch sigma",
        np.rad2deg(sigma[1]),
        high=np.rad2deg(limits.max_pitch_sigma_rad),
        unit="deg",
    )
    attempt.check(
        "estimate", "roll sigma", np.rad2deg(sigma[2]), high=np.rad2deg(limits.max_roll_sigma_rad), unit="deg"
    )
    failure = limits_failure(extrinsics, sigma, limits)
    if failure is not None:
        return attempt.result(None, failure)
    return attempt.result(RoadEstimate(extrinsics, covariance, inliers, free_fraction, support.range_m), None)
