"""What recordings, lists and calibrations can be: limits of what is read.

No settings of a run: they tell a file that is meant from one that is broken, hostile or in other units, and keep the
memory of the machine. Each says why it is so large.
"""

from __future__ import annotations

import numpy as np

MIB = 1 << 20

# Files

MOST_BYTES_OF_A_CALIBRATION = 256 << 10
"""A calibration of ten cameras with every matrix in full is about 20 kB; a bag of a hundred topics in a hundred files
says about 60 kB of itself."""
MOST_BYTES_OF_A_LIST = 64 * MIB
MOST_BYTES_OF_A_TABLE = 256 * MIB
"""A million rows of twelve numbers in full."""
MOST_BYTES_OF_A_PICTURE = 400 * MIB
"""64 million pixels of three colours with 16 bits."""
MOST_PIXELS = 64_000_000
MOST_PIXELS_ASIDE = 16_384
MOST_BYTES_OF_A_SCAN = 256 * MIB
"""Sixteen million points: a minute of the largest LiDAR."""
MOST_BYTES_OF_A_MESSAGE = 1 << 30
MOST_BYTES_UNPACKED_FOR_TIMES = 64 * MIB
"""Packed bags up to this size are unpacked once for the cameras' own times: five seconds of the slowest packing."""
LONGEST_LINE = 4096
"""Characters; a row of 17 numbers in full is 400."""
MOST_ROWS = 2_000_000
"""Two days at ten frames a second: more is no list of frames."""
MOST_FRAMES = 1_000_000
MOST_POSES_OF_A_BAG = 200_000
MOST_CALIBRATIONS_IN_A_FOLDER = 60
MOST_FOLDERS_OF_A_DRIVE = 200
LOOKED_AT = 5
"""Pictures or scans that tell what all of a recording are like."""

# Archives

MOST_BYTES_OF_AN_ARCHIVE, MOST_FILES_OF_AN_ARCHIVE = 50_000_000_000, 500_000
SPARE_BYTES = 1_000_000_000
"""Left free on the disk."""
MOST_RATIO = 200
"""Text of numbers packs to a fifth, a black picture to a hundredth; a thousandth is a bomb."""

# Times

SHORTEST_STEP_S, LONGEST_STEP_S = 5e-4, 5.0
"""Between two frames: 2,000 a second ... one in five seconds."""
LEAST_FPS, MOST_FPS = 1e-3, 1e4
"""Frames a second that a file may state."""
LIKELY_FPS = (0.1, 1000.0)
"""Frames a second that the header of a video is believed."""
UNSTATED_FPS = 10.0
"""KITTI's and most LiDARs' rate, where nothing says another."""
EPOCHS = {1: (9e8, 5e9), 10**3: (9e11, 5e12), 10**6: (9e14, 5e15), 10**9: (9e17, 5e18)}
"""What the years 1998 to 2128 are in seconds, milli-, micro- and nanoseconds, counted from 1970."""
LATE_S = 1e6
"""A clock that reads more than eleven days at the first frame counts from elsewhere than this recording."""
LARGEST_FRAME_NUMBER = 10**7
"""A first column of whole numbers below this counts frames; times since 1970 are larger in every unit."""
SAME_MOMENT = 0.01
"""A pose within this share of the time between two frames is the frame's own and is taken as it stands."""
LONGEST_BRIDGE = 3.0
"""Poses are interpolated over at most so many of their own usual steps."""
LIVE_TIMEOUT_S = 5.0
"""A camera that sends nothing for so long is gone."""

# Cameras

LEAST_BASELINE_M, MOST_BASELINE_M = 1e-3, 100.0
"""Beyond these no pair of lenses stands."""
LARGEST_BASELINE_M = 5.0
"""Wider than any vehicle: a larger number is not metres."""
SMALLEST_CONVERTED_M, LARGEST_CONVERTED_M = 0.02, 2.5
"""What a baseline given in another unit can be: a phone's pair of lenses ... the full width of a lorry."""
SIDEWAYS = 0.7
"""Least share of the baseline along the left camera's x axis: beyond 45 degrees the pair stands upright or one behind
the other, and no rectification keeps both views."""
SAME_BASELINE = 0.02
"""Two statements of one baseline agree within this share: drawings round to a centimetre."""
SAME_FOCAL = 1e-3
"""Focal lengths that are equal but for rounding in the file."""
FOCAL_OF_WIDTH = (0.05, 50.0)
"""Focal length over picture width: 168 degrees of view ... a telescope."""
LARGEST_ZOOM, SMALLEST_ZOOM = 1.25, 0.4
"""The rectified focal length over the raw one: more would only enlarge noise, less throws resolution away."""
RESIZED = 0.08
"""Off the middle by so much (logarithm of the ratio), and by the same across and down: pictures that were resized after
the calibration. Lenses sit within 3 % of the middle, and a cut takes away from one side."""
SQUEEZED = 1.6
"""The principal point so many times as far in as the middle, across or down (at four fifths): pictures that were
squeezed along one side. A cut of sky leaves it high, what would leave it so low or so far right cuts off the road."""
SAME_VIEW_RAD = float(np.deg2rad(0.1))
"""A rectification that turns the left camera by more shows another part of the scene: its focal length and
principal point do not suit a picture that keeps the left camera's own axes."""
TURNED_RAD = float(np.deg2rad(0.01))
"""A rectification that turns the left camera by more is told: angles are given to 0.01 degrees."""
SAME_AXES_RAD = 1e-6
"""Rotations below this move no pixel of a 16,000 px picture by a fiftieth of a pixel: rounding of a file."""

# Places

FARTHEST_M = 1000.0
"""No LiDAR on a vehicle sees farther: a scan most of whose points lie beyond is in other units, or none."""
MOST_RINGS = 256
LEAST_WAY_OF_A_COURSE_M = 0.05
"""Between two fixes: less says nothing of where the car was heading."""
