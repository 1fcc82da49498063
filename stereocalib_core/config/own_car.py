"""Settings of what of the own car is in the picture: its bonnet, and black borders."""

from __future__ import annotations

from pydantic.dataclasses import dataclass

from stereocalib_core.config.strict import STRICT


@dataclass(frozen=True, config=STRICT)
class OwnCarConfig:
    """The part of the picture that never moves while the car does."""

    columns: int = 320
    """Looked at in pictures shrunk to about so many columns: a bonnet is large, and a look has to cost little."""
    block: tuple[int, int] = (4, 2)
    """Width and height of the blocks that it is told in, in shrunk pixels; low, for a bonnet's edge is seen flat."""
    detail: tuple[int, int] = (9, 5)
    """What is wider and higher than so many shrunk pixels is no detail: the light of the own lamps, the mirrored sky.
    Half of the height is how far above its edge a bonnet begins to show in it."""
    noise: tuple[float, float] = (1.0, 0.02)
    """1 sigma of a shrunk pixel's difference: grey levels, of a camera's noise and of what shrinking adds; and a share
    of the light, which is not even where it comes from the own lamps."""
    most_sigmas: float = 3.0
    """What differs by more is as different as can be."""
    least_grey: float = 30.0
    """In darker pictures a black border looks as the road does."""
    black: float = 4.0
    """Darkest grey level that something lit has: black borders are 0, and a little more in a JPEG."""
    black_evidence: float = 2.0
    """What is black in all pictures is no road, by so much [log likelihood a look]."""
    step: float = 1.0
    """One look each so many camera heights: a quarter of the near road is another one."""
    least_shift: float = 2.0
    """... and where it has not, by so many, what moves can't be told from what does not."""
    apart: float = 5.0
    """What stands still is compared with the picture so many camera heights before, 8 m on a car, or up to twice as
    many: a car alongside does not keep its place so long."""
    window: float = 10.0
    """It is decided after so many camera heights more, 25 m in all on a car, ..."""
    again: float = 100.0
    """... and looked for again after so many, 165 m: it may have been too dark, and cameras get knocked."""
    reluctance: float = 0.15
    """A block of which nothing is known is rather road, by so much [log likelihood a look]."""
    jump: float = 0.5
    """A bonnet's edge goes on: what each block costs that it rises or falls between two columns [as above]."""
    other_depths: tuple[float, ...] = (0.01, 0.25, 0.4, 0.55, 0.7, 0.85, 1.2, 1.4, 1.6, 1.9, 2.2, 2.6, 3.0)
    """What stands still and lies at the road's own disparity, and at none that is so many times as large, is a shadow,
    or the light of a lamp. A bonnet is at half of the camera's height, and a mirror image behind it."""
    on_road: float = 0.8
    """It lies there where the pictures differ by no more than so much of what they do at any other depth."""
    stands: float = 1.0
    """Looked at for this are the blocks with so much evidence that they stand [log likelihood a look]."""
    least_evidence: float = 100.0
    """Log likelihood a look that a whole bonnet has for it at least: 22 blocks that differ as much as can be, no more
    than a metre of its edge. Roads without one had 38 at most: KITTI 06, 03 and 0009, Karlsruhe, and what lamps, fog
    and blurring made of 06."""
    least_columns: int = 6
    """Narrower things are no bonnet: a fifteenth of the picture."""
