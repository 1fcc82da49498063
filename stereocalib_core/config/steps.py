"""Settings of the search for steps in a noisy series: change points, what humps hide, jumps of the heading."""

from __future__ import annotations

from pydantic.dataclasses import dataclass

from stereocalib_core.config.strict import STRICT, Share


@dataclass(frozen=True, config=STRICT)
class StepConfig:
    """Change points by a likelihood ratio on whitened values. Counts are frames; tuned on synthetic drives with and
    without knocks unless said otherwise."""

    lags: int = 4
    """Of the autoregression: springs swing with two, the odometry's noise needs two more."""
    before: int = 60
    """Values before a step that its level is compared with."""
    level_window: int = 121
    """Of the running median that is the slow level: far longer than a swing."""
    restless_window: int = 21
    """Where several frames nearby are wild, one more is no news: the window of that, and from how many usual
    deviations on it counts."""
    restless_factor: float = 1.7
    near: int = 8
    """So near to a step no other value may be off by more than `calm` of it, nor by `usual` usual deviations."""
    calm: Share = 0.6
    usual: float = 4.5
    at_once: tuple[int, int] = (3, 8)
    """Values on either side whose medians must differ by a step: at once, and later."""
    later: tuple[int, int] = (24, 60)
    stays: Share = 0.35
    """By at least so much of its size."""
    skipped: int = 10
    """No step is looked for in the first values of a series."""
    candidates: int = 40
    """So many are looked at closely, surest first."""
    shortest: int = 6
    """Size by the first values alone where they show it so well, 1 sigma as a share: the autoregression holds best
    at once. Otherwise by more values. The second with a witness, whose series swings less and is followed better."""
    sharp: tuple[float, float] = (0.1, 0.25)
    known_share: Share = 0.85
    """Of the values around a step that must be known: what fails beside a jump is no mount."""
    short_drive: float = 30.0
    """Values; a drive not much longer has not shown how far they may stray, and the threshold is higher."""


@dataclass(frozen=True, config=STRICT)
class TurmoilConfig:
    """Steps across stretches where the springs swing by more than any knock. Counts are frames."""

    window: int = 21
    """Of the running median; wild is what lies off it by `wild` usual deviations."""
    wild: float = 6.0
    joined: int = 6
    """Wild frames so near make one stretch; margins before and behind it, where springs settle."""
    lead: int = 3
    settle: int = 5
    longest: int = 30
    """No longer stretch is looked across."""
    levels: tuple[int, int] = (30, 45)
    """Values on either side that make a level; a step is told by the first or, surer, by the second."""
    least_score: float = 4.5
    """In deviations of calm stretches, and in least sizes."""
    least_size: float = 1.35
    least_noise: float = 3.0
    """Levels differ by at least so many times the least deviation of one value: a short drive may look calmer."""
    each_half: Share = 0.6
    """Each half of both levels must bear out so much of the step."""
    calm_places: int = 40
    """Fewer calm places say nothing of what a difference is worth."""


@dataclass(frozen=True, config=STRICT)
class PairStepConfig:
    """Knocks of one camera against the other: steps of a constant with noise."""

    least_side: int = 8
    """Looks on either side of a step; fewer may be one bad stretch of matches."""
    sure: float = 6.0
    """A step must be so many times its own sigma: there are hundreds of places where chance could put one."""
    clip: float = 4.0
    """Looks further from the median of their neighbours than so many sigmas count as if they were so far."""
    least_scatter: float = 1e-6
    """Of looks, in their own sigmas: looks that are all the same scatter by nothing."""
    neighbours: int = 9
    """Of the running median, in frames: outlasts a few bad frames, follows a step."""


@dataclass(frozen=True, config=STRICT)
class YawStepConfig:
    """Jumps of the camera's own heading that last."""

    before: int = 10
    """Fewer pairs on straights before a knock are no level."""
    alike: float = 6.0
    """So many neighbouring pairs count as one."""
    pulse_sigmas: float = 8.0
    """A jump stands out by so many usual deviations, a level by so many of its own."""
    level_sigmas: float = 3.0
    pulse_sigma_deg: float = 0.04
    """1 sigma of jump and level that come from how bends begin and roads tilt [deg]."""
    level_sigma_deg: float = 0.02
    agree: tuple[float, float] = (0.5, 1.6)
    """The level must change by the jump, within these factors."""
    most: int = 4
    """Jumps looked for."""
