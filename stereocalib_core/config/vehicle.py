"""What is assumed of the car that carries the cameras: springs, lever arm, how it leans."""

from __future__ import annotations

from pydantic.dataclasses import dataclass

from stereocalib_core.config.strict import STRICT, Share

USUAL_HEIGHT_M = 1.65
"""Of a camera over the road [m], where nothing has been measured yet. Source: KITTI's car (Geiger et al. 2013)."""


@dataclass(frozen=True, config=STRICT)
class VehicleConfig:
    """A passenger car. All of it is physics of the vehicle; what a drive shows of it replaces these values."""

    natural_hz: float = 1.4
    """Of the body on its springs [Hz]. Physics: passenger cars are built for 1 to 1.5 Hz (Gillespie, Fundamentals of
    Vehicle Dynamics, ch. 5)."""
    damping: Share = 0.35
    """Of the critical one. Physics: 0.2 to 0.4 in passenger cars (same source)."""
    lever_arm_m: float = 0.95
    """Camera ahead of the rear axle [m], where no rig file and no turn of the drive says better. Source: KITTI's car
    (Geiger et al. 2013, figure 3)."""
    lever_arm_sigma_m: float = 0.3
    """1 sigma of that [m], and the most that an estimate may have to replace it. Physics: between dashboard and
    roof."""
    lever_arm_prior_sigma_m: float = 0.7
    """1 sigma with which the estimate itself is held near the default [m]; wide, so that a few turns outweigh it."""
    sway_m: float = 1.2
    """Height of the camera over the axis about which car and road roll [m]: how far it moves sideways per roll.
    Physics: mounting height less the roll centre's, some 0.4 m."""
    sway_sigma_m: float = 0.4
    """1 sigma of that [m]."""
    lean_sigma_deg: float = 0.2
    """1 sigma of pitch per m/s^2 of braking and of roll per m/s^2 of cornering [deg]. Physics: a soft car leans half
    a degree."""
    steady_braking_m_s2: float = 1.45
    """Harder braking or accelerating is no steady driving [m/s^2]. Physics: comfortable traffic stays below it."""
    steady_cornering_m_s2: float = 0.7
    """The same across [m/s^2]."""
    slip: float = 1.5e-3
    """Sideways motion per metre of travel that real tyres and roads add, 1 sigma [m/m]. Tuned on the synthetic town
    and checked on KITTI 06 and 03."""
