"""Why frames failed: what the front end measured in them, held against the good frames of the same drive.

Light makes texture, texture makes matches, matches make the road. So of the numbers that left the usual by far, those
nearest to the light tell the cause, and the later ones are what came of it; among numbers of one step, the one that
moved by the most robust sigmas leads. Where none of them left the usual, the reason speaks for itself; where hardly a
frame is good, there is no usual, and a number that all but misses its limit tells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stereocalib_core.back.remedies import REMEDIES, UPSIDE_DOWN
from stereocalib_core.back.spans import Span, failed_spans
from stereocalib_core.config.back import CausesConfig, YawConfig
from stereocalib_core.errors import FailureReason
from stereocalib_core.numeric.arrays import Array, Mask
from stereocalib_core.numeric.robust import mad_sigma
from stereocalib_core.results import Cause, DepthScale, FrameResult


@dataclass(frozen=True)
class Quantity:
    """One number of the front end, and what it means when it leaves the usual.

    stage, name: of its `Check`. words: with `{now}` and `{usual}`. bad: -1 = less is worse, +1 = more is.
    step: 0 light, 1 texture, 2 matches, 3 the road. noise: the least 1 sigma that it can have, in its own unit.
    cause, remedy: None where it only follows from others.
    """

    stage: str
    name: str
    words: str
    bad: int
    step: int
    noise: float
    cause: str | None = None
    remedy: str | None = None


_UNMATCHED = (
    "left and right have little in common: dirt or drops on a lens, rain, focus, or not taken at once"
)
_MATCH_THEM = "clean both lenses; check the focus, and that both cameras trigger together"
QUANTITIES = (
    Quantity(
        "image", "mean grey", "grey {now:.0f} instead of {usual:.0f}", -1, 0, 2.0,
        "too dark", "raise exposure or gain, or switch on light; look whether a lens is covered",
    ),
    Quantity(
        "image", "saturated share", "{now:.0%} white instead of {usual:.0%}", 1, 0, 0.02,
        "too bright: glare or over-exposure", "lower the exposure; shade the lens",
    ),
    Quantity(
        "image", "texture", "texture {now:.1f} instead of {usual:.1f} grey/px", -1, 1, 0.1,
        "the picture has lost its texture: fog, snow, a wall, blur, dirt on the lens",
        "clean the lens; check the focus",
    ),
    Quantity(
        "rectification", "left-right matches", "{now:.0f} matches instead of {usual:.0f}", -1, 2, 5.0,
        _UNMATCHED, _MATCH_THEM,
    ),
    Quantity(
        "disparity", "valid share, lower half", "{now:.0%} of the lower half matched instead of {usual:.0%}", -1, 2,
        0.02, _UNMATCHED, _MATCH_THEM,
    ),
    Quantity(
        "region", "share of the way ahead", "road on {now:.0%} of the way ahead instead of {usual:.0%}", -1, 3, 0.02
    ),
    Quantity("region", "on the plane", "{now:.0%} of it on the plane instead of {usual:.0%}", -1, 3, 0.02),
    Quantity(
        "direct", "patches on the plane", "{now:.0%} of the patches on one plane instead of {usual:.0%}", -1, 3, 0.02
    ),
    Quantity(
        "direct", "near road over the plane, rms", "near road {now:.0f} mm rms off its plane instead of {usual:.0f}", 1,
        3, 2.0,
    ),
)  # fmt: skip
_NEAR_ABOVE = ("picture", "nearness above over below")
"""Stage and name of the check that fails where a picture stands on its head."""
SEEN = frozenset(
    {
        FailureReason.DARK,
        FailureReason.SATURATED,
        FailureReason.FLAT_TEXTURE,
        FailureReason.NO_DISPARITY,
        FailureReason.NO_ROAD,
        FailureReason.NOT_PLANAR,
        FailureReason.TOO_UNCERTAIN,
        FailureReason.OUT_OF_RANGE,
        FailureReason.INCONSISTENT,
    }
)
"""Reasons that may have another one behind them. The rest are causes themselves: a cable, a file, a calibration."""


@dataclass(frozen=True)
class Change:
    """One number in failed frames (`now`, their median) and in the good ones (`usual`, theirs).

    sigmas: by how many robust sigmas it moved for the worse. near: in the good frames just before and after, None where
    there are none. far: by the factor and the sigmas that tell a cause.
    """

    quantity: Quantity
    now: float
    usual: float
    sigmas: float
    near: float | None
    near_differs: bool
    far: bool

    @property
    def words(self) -> str:
        """`grey 15 instead of 70`, and what it was in the good frames around where that is not the usual."""
        told = self.quantity.words.format(now=self.now, usual=self.usual)
        if self.near is None or not self.near_differs:
            return told
        near = f"{self.near:.0%}" if "%" in self.quantity.words else f"{self.near:.3g}"
        return f"{told} (in the good frames around it {near})"


def find_causes(results: Sequence[FrameResult], config: CausesConfig | None = None) -> tuple[Cause, ...]:
    """The likely cause of every stretch of frames that failed for one reason, in order."""
    config = config or CausesConfig()
    spans = failed_spans(results)
    if not spans:
        return ()
    ok: Mask = np.array([r.ok for r in results], dtype=bool)
    values = _values(results)
    return tuple(_cause(span, results, changes(span, results, values, ok, config), config) for span in spans)


def calibration_of_others(
    yaw_rad: float | None,
    scale: DepthScale | None,
    results: Sequence[FrameResult],
    yaw_config: YawConfig,
    config: CausesConfig,
) -> tuple[Cause, ...]:
    """CALIBRATION over the whole drive where the camera seems to look far beside the car's way.

    And where what knows metres says that all depths are another multiple than a calibration is ever off by.
    """
    found = []
    if yaw_rad is not None and abs(np.rad2deg(yaw_rad)) > yaw_config.most_deg:
        aside = f"the camera seems to look {np.rad2deg(yaw_rad):+.1f} deg beside where the car goes"
        found.append(f"{aside}, at most {yaw_config.most_deg:g}")
    if scale is not None and abs(scale.value - 1.0) > max(config.most_scale, config.sigmas * scale.sigma):
        whom = "LiDAR" if scale.source == "lidar" else "known path"
        found.append(
            f"by the {whom} true depths are {scale.value:.2f} times what is measured: so is focal length times "
            f"baseline{'' if scale.source == 'lidar' else ', or the path is that of other frames'}"
        )
    if not found:
        return ()
    reason = FailureReason.CALIBRATION
    cause, remedy = REMEDIES[reason]
    words = f"{cause} ({'; '.join(found)})"
    return (Cause(results[0].frame, results[-1].frame, str(reason), words, remedy),)


def changes_at(
    results: Sequence[FrameResult], frame: int, config: CausesConfig | None = None
) -> list[Change]:
    """What moved for the worse in the stretch of failed frames that `frame` lies in; empty where it has not failed."""
    span = next((s for s in failed_spans(results) if s.first <= frame <= s.last), None)
    if span is None:
        return []
    ok: Mask = np.array([r.ok for r in results], dtype=bool)
    return changes(span, results, _values(results), ok, config or CausesConfig())


def changes(
    span: Span, results: Sequence[FrameResult], values: Array, ok: Mask, config: CausesConfig
) -> list[Change]:
    """What moved for the worse in a stretch, the step nearest to the light first, in it the most sigmas.

    values: (N, quantities), NaN where not measured. ok: (N,) which frames are good.
    """
    numbers = np.array([r.frame for r in results])
    inside = (numbers >= span.first) & (numbers <= span.last)
    before = np.flatnonzero(ok & (numbers < span.first))[-config.neighbours :]
    after = np.flatnonzero(ok & (numbers > span.last))[: config.neighbours]
    around = np.concatenate([before, after])
    found = []
    for k, quantity in enumerate(QUANTITIES):
        now, good, near = (_finite(values[chosen, k]) for chosen in (inside, ok, around))
        if len(now) and len(good) >= config.least_frames:
            found.append(_change(quantity, now, good, near, config))
    worse = [change for change in found if change.sigmas > 0]
    return sorted(worse, key=lambda c: (not c.far, c.quantity.step if c.far else 0, -c.sigmas))


def _change(quantity: Quantity, now: Array, good: Array, near: Array, config: CausesConfig) -> Change:
    value, usual = float(np.median(now)), float(np.median(good))
    sigma = max(mad_sigma(good, None), quantity.noise, config.least_share * abs(usual))
    sigmas = quantity.bad * (value - usual) / sigma
    by_factor = value * config.factor <= usual if quantity.bad < 0 else value >= config.factor * usual
    around = float(np.median(near)) if len(near) else None
    differs = around is not None and abs(around - usual) > config.sigmas * sigma
    return Change(quantity, value, usual, sigmas, around, differs, by_factor and sigmas >= config.sigmas)


def _cause(
    span: Span, results: Sequence[FrameResult], found: Sequence[Change], config: CausesConfig
) -> Cause:
    """The leading cause in words, with its numbers; where no number tells one, the reason's own."""
    reason = FailureReason(span.reason)
    if (turned := _upside_down(span, results)) is not None and reason in UPSIDE_DOWN:
        cause, remedy = UPSIDE_DOWN[reason]
        return Cause(span.first, span.last, span.reason, f"{cause} ({turned})", remedy)
    leading = next((c for c in found if c.far and c.quantity.cause is not None), None)
    if reason in SEEN and leading is not None and leading.quantity.remedy is not None:
        told = [leading, *(c for c in found if c.far and c is not leading)][: config.named]
        words = f"{leading.quantity.cause}: {', '.join(c.words for c in told)}"
        return Cause(span.first, span.last, span.reason, words, leading.quantity.remedy)
    cause, remedy = REMEDIES[reason]
    if reason in SEEN and sum(r.ok for r in results) < config.least_frames:
        poor = _near_its_limit(span, results, config)
        if poor is not None:
            return Cause(span.first, span.last, span.reason, *poor)
    details = next((r.failure.detail for r in results if r.frame == span.first and r.failure is not None), "")
    moved = [c.words for c in found if c.sigmas >= config.sigmas] if reason in SEEN else []
    numbers = "; ".join(part for part in (details, ", ".join(moved[: config.named])) if part)
    return Cause(span.first, span.last, span.reason, f"{cause} ({numbers})" if numbers else cause, remedy)


def _upside_down(span: Span, results: Sequence[FrameResult]) -> str | None:
    """By how much what is near lies above in most frames of a stretch, in words; None where it does not."""
    inside = [r for r in results if span.first <= r.frame <= span.last]
    found = [c for r in inside for c in r.checks if (c.stage, c.name) == _NEAR_ABOVE and not c.ok]
    if 2 * len(found) <= len(inside):
        return None
    return f"{np.median([c.value for c in found]):.1f} times as near as what lies below"


def _near_its_limit(
    span: Span, results: Sequence[FrameResult], config: CausesConfig
) -> tuple[str, str] | None:
    """Cause and remedy by the first number that all but misses its own limit, where no good frame tells the usual."""
    inside = [r for r in results if span.first <= r.frame <= span.last]
    for quantity in QUANTITIES:
        if quantity.cause is None or quantity.remedy is None:
            continue
        name = (quantity.stage, quantity.name)
        checks = [c for r in inside for c in r.checks if (c.stage, c.name) == name]
        limits = [limit for c in checks if (limit := c.low if quantity.bad < 0 else c.high) is not None]
        if not limits:
            continue
        value, limit = float(np.median([c.value for c in checks])), float(np.median(limits))
        near = value <= config.factor * limit if quantity.bad < 0 else value * config.factor >= limit
        if near:
            words = f"{quantity.name} {value:.3g}, where {limit:.3g} is the {'least' if quantity.bad < 0 else 'most'}"
            return f"{quantity.cause} ({words})", quantity.remedy
    return None


def _values(results: Sequence[FrameResult]) -> Array:
    """(N, quantities) of the checks, NaN where a frame did not come so far."""
    place = {(q.stage, q.name): k for k, q in enumerate(QUANTITIES)}
    values = np.full((len(results), len(QUANTITIES)), np.nan)
    for i, result in enumerate(results):
        for check in result.checks:
            k = place.get((check.stage, check.name))
            if k is not None:
                values[i, k] = check.value
    return values


def _finite(values: Array) -> Array:
    return np.asarray(values[np.isfinite(values)])
