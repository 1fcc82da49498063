"""The rendered town, its car and its sensors: what was chosen for `synthetic`, and why.

None of these is a setting of a run, and no estimator reads them: a drive is described by its spec alone. What compiled
loops hold as constants stands beside the loops.
"""

from __future__ import annotations

import numpy as np

# The course: x to the right of the middle of the car's own lane [m].
STEP_M = 0.05
"""Between samples of a course: a twentieth of the way between two frames."""
FRAME_RATE_HZ = 10.0
"""KITTI's."""
STRAIGHT_M, PLANE_M = 300.0, 200.0
"""Length of the courses `straight` and `plane`: 10 s or more at town speed."""
BEND_RAMP_M = 7.0
"""Over which a bend's curvature grows: a steering wheel turned in a second or so."""
LATERAL_LIMIT, ACCELERATION, BRAKING = 2.4, 1.5, 2.0
"""[m/s^2] of a driver whom nobody hurries, to the side, forwards and backwards."""
SPEED_MAX = 11.0
"""[m/s] 40 km/h, a town."""
STOP_S = 2.5
"""Of standing at a line: enough frames to see how a car that stands is taken."""
SMOOTH_M, SMOOTH_HEIGHT_M, SMOOTH_BANK_M = 2.0, 10.0, 12.0
"""Of the Gaussians by which the road under somebody else's poses is smoothed, on the map, in height and in bank: what
is shorter is taken for the car's own motion on its springs."""
WHEELBASE_M, TRACK_M = 2.71, 1.5
"""A passenger car's; the wheelbase is that of KITTI's (its page on the sensors)."""
RAMP_AHEAD_M = 14.0
"""From the camera to the foot of `fault=ramp` at its first frame: inside what the road is measured over."""

# The road.
LEFT_KERB_M, RIGHT_KERB_M = -5.25, 4.0
LANE_EDGE_M, CROWN_M = 1.75, -1.75
"""Two lanes of 3.5 m, the crown between them, and a strip to park on."""
PAVEMENT_LEFT_M, PAVEMENT_RIGHT_M = -8.0, 6.6
"""Pavements of 2.6 m and more."""
HALF_WIDTH_M = 12.8
"""What is meshed on either side: pavements, hedges and the ground before the houses."""
KERB_WIDTH_M, KERB_HEIGHT_M = 0.12, 0.12
"""A kerbstone's usual size."""
HUMP_LENGTH_M, HUMP_HEIGHT_M = 3.6, 0.06
"""A speed hump as town streets have them."""
CAMBER_DROP_M = 0.03
"""How much lower a lane's edge is than the crown: less than the 2.5 % that roads are built with, since a plane is the
truth here."""
FLAT_CURVATURE = 0.02
"""From this curvature [1/m] on a bend has no crown at all: built with one side to the other."""
FIT_SPREAD_M = 12.0
"""So far around a bend the crown is gone too: most of the lane that is fitted has one cross fall."""
FIT_NEAR_M, FIT_FAR_M = 4.0, 20.0
"""The true plane is that of the lane between these ahead of the camera: what a road is measured over."""
COLUMNS_M = np.array(
    [-12.8, -8.0, -5.37, -5.25, -4.3, -3.4, -2.6, -1.75, -1.05, -0.35, 0.35, 1.05, 1.75, 4.0, 4.12, 6.6, 12.8]
)
"""Of the mesh: at every edge of the above, and close enough between to bend with the camber."""
AHEAD_M, BEHIND_M = 140.0, 12.0
"""How much of the ribbon is drawn from the car: a disparity of 2.7 px, less than is matched."""

# What stands and moves beside it.
CAR_TONES = (0.22, 0.35, 0.6, 0.95, 1.15, 1.5, 1.75)
"""Of grey: black to white paint."""
TREES, HOUSES = 5, 10
"""Different ones, chosen by eye."""
CLEAR_M = 7.6
"""No house or hedge comes nearer to any part of the course: beyond the pavement."""
ONCOMING_M, ONCOMING_SPEED = -3.55, 9.0
"""Where the others come from, in their own lane, and how fast [m/s]: 32 km/h."""
TRUCK_AHEAD_M = 2.3
"""`fault=truck`: from the camera to its tail, which then fills the picture."""

# Light.
SUN = np.array([np.sin(0.9) * np.cos(0.75), -np.sin(0.75), np.cos(0.9) * np.cos(0.75)])
"""Direction to the sun, 43 deg high and to the right: shadows lie across the road, where they disturb most."""
AMBIENT, SUNLIGHT = 0.42, 1.6
"""Shade is a fifth as bright as what the sun hits in full: a clear day."""
SEEN_M, HAZE_GREY = 170.0, 190.0
"""[m] beyond which nothing is drawn, and the grey that far things fade to."""
MOST_VISIBLE = 60_000
"""Triangles in one view; what is more is left out."""

# What weather, light and dirt do: chosen by eye.
NIGHT_NOISE = 3.5
"""Factor on the sensor's noise at night: the gain is up."""
NIGHT_LIGHT, HEADLIGHTS = 0.035, 0.32
"""Of daylight: what street lamps leave, and what the car's own lamps put on the road ahead."""
GLARE = 520.0
"""Grey that a low sun adds where it stands: twice what a picture holds."""
DIRTY_SHARE = 0.45
"""Of the left picture."""
LARGEST_FAULT = {"deg": 30.0, "m": 5.0}
"""Beyond, the road is out of sight or no mount is meant."""

# The car's body on its springs.
PITCH_PER_BRAKING = np.deg2rad(0.22)
"""Nose down [rad] per m/s^2 of braking: half a degree at a brisk stop."""
ROLL_PER_LATERAL = np.deg2rad(0.20)
"""The body leans outward: horizon falls to the right by this [rad] per m/s^2 towards the right."""
NATURAL_HZ, DAMPING = 1.4, 0.35
"""Passenger cars: 1 to 1.5 Hz, damped by 0.2 to 0.4 (Gillespie, Fundamentals of Vehicle Dynamics, 1992, ch. 5)."""
ROUGH = (0.006, float(np.deg2rad(0.09)), float(np.deg2rad(0.06)))
"""What an uneven road adds at full speed, as standard deviations of height [m], pitch and roll [rad]."""
LOAD = (-0.015, -float(np.deg2rad(0.25)), 0.0)
"""What a full boot adds to height [m], pitch and roll [rad]."""

# The cameras.
EXPOSURE_S = 0.003
"""Over which moving pictures blur: daylight."""
EXPOSURE_DIFFERENCE = 0.02
"""How much brighter the right picture is at amount 1: two cameras of one batch."""
VIGNETTING = 0.16
"""What is lost in the far corners at amount 1."""
BLUR = 0.03
"""Share of the light that falls on each direct neighbour, in x and in y: a lens as sharp as its pixels."""
RECTIFICATION_ERROR_DEG = (0.01, 0.02)
"""Pitch and roll of the right camera at amount 1 of `rectification_error`: a tenth of a row, a good rig's."""

# The LiDAR: as on KITTI's car, a Velodyne HDL-64E (its manual: 64 beams, +2 to -24.8 deg, 2 cm).
BEAMS, AZIMUTHS = 64, 1800
HIGHEST_DEG, LOWEST_DEG = 2.0, -24.8
RANGE_M = (2.0, 90.0)
RANGE_NOISE_M = 0.02
SCAN_WIDTH_PX, SCAN_HEIGHT_PX, SCAN_FOCAL_PX, SCAN_CY_PX = 640, 400, 320.0, 120.0
"""Of each of the four views, 90 deg wide, that a beam reads its triangle from: the lowest beam is in it."""
