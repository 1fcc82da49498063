"""Clouds that were given to the wrong pictures: is there one transform under which they fit others?"""

from __future__ import annotations

import numpy as np

from stereocalib_core.boards.consensus import Candidates, agree
from stereocalib_core.boards.detect import Detection
from stereocalib_core.config.boards import FINDING
from stereocalib_core.config.boards_search import CONSENSUS


def shuffled_clouds(found: Detection) -> dict[str, str]:
    """NAME of a cloud to NAME of the picture that it fits; empty unless most clouds fit another than their own.

    Every board-like place of every cloud is tried with every picture; a transform that chance finds explains few.
    """
    seen = [o.camera_plane for o in found.observations]
    pictures = [i for i, plane in enumerate(seen) if plane is not None]
    rows = [
        (picture, cloud, place)
        for picture in pictures
        for cloud, places in enumerate(found.candidates)
        for place in places[: FINDING.places_per_cloud]
    ]
    if len(pictures) < FINDING.least_pictures or not rows:
        return {}
    planes = [p for picture, _, _ in rows if (p := seen[picture]) is not None]
    flat = Candidates(
        np.array([picture for picture, _, _ in rows], dtype=np.int64),
        np.array([p.center for p in planes]),
        np.array([p.plane.normal for p in planes]),
        np.array([place.outline.center for _, _, place in rows]),
        np.array([place.plane.normal for _, _, place in rows]),
        np.array([place.outline.score for _, _, place in rows]),
        np.array([cloud for _, cloud, _ in rows], dtype=np.int64),
    )
    agreement = agree(flat, len(found.observations), CONSENSUS.detection_share * found.board.short_side_m)
    if agreement is None:
        return {}
    fits: dict[int, int] = {}
    for picture, chosen in enumerate(agreement.chosen):
        if chosen >= 0:
            fits.setdefault(rows[int(chosen)][1], picture)
    names = [o.name for o in found.observations]
    swapped = {names[cloud]: names[picture] for cloud, picture in fits.items() if cloud != picture}
    enough = max(FINDING.least_pictures, FINDING.most_refused * len(pictures))
    return swapped if len(swapped) >= enough else {}
