"""The lesson of the pair's own yaw: a slider bends the pair of this drive, and motion finds by how much."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panel import Host
from stereocalib_app.drive.session import Session, Snapshot
from stereocalib_app.widgets import palette, text
from stereocalib_app.widgets.tables import note
from stereocalib_app.words.lessons import BENDS_DEG, bend_words
from stereocalib_core.back.analyse import analyse
from stereocalib_core.back.rig.pair_evidence import results_mended
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.results import BEST, Drive, Measured, PairCorrection

MOST_FRAMES = 200
"""Of a long drive its first frames are bent: they show all there is, within a second or two."""
LEAST_FRAMES = 12
MAP_PX = (280, 150)
WAIT = "As soon as some frames are computed the slider bends their pair."
STRAIGHT, BENT = palette.VARIANT["autocalibrated"], palette.FAILED


@dataclass(frozen=True)
class Bent:
    """A drive's own numbers, as recorded or with its pair bent.

    pitch_rad: of the road, median. path_m. yaw: of the pair by motion. places: (N, 2) x, z [m] of the camera.
    """

    pitch_rad: float
    path_m: float | None
    yaw: Measured | None
    places: Array

    @classmethod
    def of(cls, drive: Drive) -> Bent:
        """What the lesson tells of a drive."""
        poses = drive.paths[BEST].poses
        pitch = float(np.nanmedian(drive.frames.pitch_rad)) if drive.frames.ok.any() else float("nan")
        return cls(pitch, drive.paths[BEST].errors.path_m, drive.pair.relative_yaw_rad, poses[:, [0, 2], 3])


def bent(session: Session, snapshot: Snapshot, bend_deg: float) -> Bent:
    """The drive so far as it would have been measured with its right camera turned by so much.

    Tracks and roads are bent as the turn bends their disparities; everything after them is computed again.
    """
    results = [dataclasses.replace(r, scan=None, disparities=None) for r in snapshot.results[:MOST_FRAMES]]
    if bend_deg:
        results = results_mended(session.camera, results, PairCorrection(yaw_rad=-np.deg2rad(bend_deg)))
    return Bent.of(analyse(results, session.camera, session.config))


def bend_table(straight: Bent, now: Bent, bend_deg: float) -> str:
    """As recorded against bent, and what the measurement says of the bend."""
    rows = [
        (
            "road's pitch, median",
            *(text.number(float(np.rad2deg(b.pitch_rad)), 3, "°") for b in (straight, now)),
        ),
        ("path", *(text.number(b.path_m, 2, " m") for b in (straight, now))),
        ("relative yaw, by motion", *(_yaw(b.yaw) for b in (straight, now))),
    ]
    table = text.table(
        ["", "as recorded", f"bent by {text.number(bend_deg, 2, '°')}"], [list(r) for r in rows]
    )
    return f"{table}\n\n{bend_words(bend_deg, now.yaw, straight.yaw)}"


def _yaw(yaw: Measured | None) -> str:
    if yaw is None:
        return "not measured"
    return text.with_sigma(float(np.rad2deg(yaw.value)), float(np.rad2deg(yaw.sigma)), 4, "°")


def paths_svg(straight: Array, now: Array) -> str:
    """Both paths (N, 2) x, z [m] from above, ahead upwards, to one scale."""
    known = [p[np.isfinite(p).all(axis=1)] for p in (straight, now)]
    if not all(len(p) > 1 for p in known):
        return ""
    both = np.concatenate(known)
    low, size = both.min(axis=0), np.maximum(np.ptp(both, axis=0), 1.0)
    # the longer side lies along the picture
    along = (1, 0) if size[1] >= size[0] else (0, 1)
    scale = min((MAP_PX[0] - 20) / size[along[0]], (MAP_PX[1] - 20) / size[along[1]])
    height = 20.0 + size[along[1]] * scale
    lines = ""
    for places, colour, width in ((known[0], STRAIGHT, 4), (known[1], BENT, 2)):
        at = 10.0 + (places - low)[:, list(along)] * scale
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in at)
        lines += (
            f'<polyline points="{points}" fill="none" stroke="rgb{tuple(colour)}" stroke-width="{width}"/>'
        )
    label = "Path from above, as recorded (thick) and bent (thin)"
    return (
        f'<svg role="img" aria-label="{label}" viewBox="0 0 {MAP_PX[0]} {height:.0f}" style="width:100%">{lines}</svg>'
        + note(f"{label}.")
    )


class BendLesson:
    """A folder of the lesson; `show` is told which bend the pictures are to have."""

    def __init__(self, host: Host, show: Callable[[float], None]) -> None:
        gui, self._show = host.gui, show
        self._folder = gui.add_folder("Bend the pair")
        with self._folder:
            self._slider = gui.add_slider(
                "Turn (°)",
                min=BENDS_DEG[0],
                max=BENDS_DEG[-1],
                step=BENDS_DEG[1] - BENDS_DEG[0],
                initial_value=0.0,
            )
            self._table = gui.add_markdown(WAIT)
            self._map = gui.add_html("")
        self._known: tuple[Session, Snapshot] | None = None
        self._straight: tuple[int, Bent] | None = None
        host.on_input(self._slider, self.bend)

    def bend(self, bend_deg: float) -> None:
        """Bend the drive by the nearest of `BENDS_DEG`, in pictures and numbers."""
        nearest = min(BENDS_DEG, key=lambda one: abs(one - bend_deg))
        self._show(nearest)
        self.measure(nearest)

    def measure(self, bend_deg: float) -> None:
        """The numbers of the drive with its pair bent by so much."""
        if self._known is None or len(self._known[1].results) < LEAST_FRAMES or not self._known[0].tracks:
            self._table.content = WAIT
            return
        session, snapshot = self._known
        count = min(len(snapshot.results), MOST_FRAMES)
        if self._straight is None or self._straight[0] != count:
            self._straight = count, bent(session, snapshot, 0.0)
        straight = self._straight[1]
        now = bent(session, snapshot, bend_deg)
        self._table.content = bend_table(straight, now, bend_deg)
        self._map.content = paths_svg(straight.places, now.places)

    def update(self, moment: Moment, shown: bool, bend_deg: float) -> None:
        """Keep what there is of the drive. shown: whether this is the lesson. bend_deg: of the pictures."""
        if self._known is None or self._known[0] is not moment.session:
            self._straight = None
        self._known = moment.session, moment.snapshot
        if self._folder.visible != shown:
            self._folder.visible = shown
        if abs(self._slider.value - bend_deg) > 1e-6:
            self._slider.value = bend_deg
