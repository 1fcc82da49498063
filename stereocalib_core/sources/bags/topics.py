"""Which topics are the left and the right camera, found by type and name, or as the user names them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass

from stereocalib_core.errors import SourceError
from stereocalib_core.sources.bags.messages import CAMERA_INFO, CLOUD, IMAGES, POSES
from stereocalib_core.sources.sides import camera_number, side_of

_RANKS = ("rect", "raw", "mono", "image", "color")
_SKIPPED = (
    "depth",
    "disparity",
    "confidence",
    "mask",
    "segment",
    "label",
    "thumbnail",
    "theora",
    "h264",
    "infra_depth",
)


@dataclass(frozen=True)
class Topics:
    """left, right: pictures. left_info, right_info, lidar, truth: None where there is none."""

    left: str
    right: str
    left_info: str | None
    right_info: str | None
    lidar: str | None
    truth: str | None
    notes: tuple[str, ...]

    @property
    def rectified(self) -> bool:
        """Whether the pictures' names say that they are rectified already."""
        return "rect" in self.left.lower().rpartition("/")[0] + self.left.lower().rpartition("/")[2]


def choose(
    types: Mapping[str, str], counts: Mapping[str, int], wanted: Mapping[str, str], where: object
) -> Topics:
    """The topics to read; raises SourceError, in one line with the candidates, where there is more than one choice.

    types: topic to message type. counts: topic to number of messages. wanted: left, right, lidar, truth by name.
    """
    for key in ("left", "right", "lidar", "truth", "left_info", "right_info"):
        if key in wanted and wanted[key] not in types:
            near = ", ".join(sorted(types)[:12])
            raise SourceError(f"no topic {wanted[key][:60]}", where, f"it has {near}")
    notes = []
    if "left" in wanted and "right" in wanted:
        left, right = wanted["left"], wanted["right"]
    else:
        left, right = _pictures(types, counts, where, wanted)
        notes.append(f"pictures from {left} and {right}")
    for topic in (left, right):
        if types[topic] not in IMAGES:
            raise SourceError(f"{topic} holds no pictures", where, f"it is {types[topic]}")
    infos = [
        wanted.get(f"{side}_info") or _info(topic, types)
        for side, topic in (("left", left), ("right", right))
    ]
    lidar = wanted.get("lidar") or _one_of(
        [t for t, kind in types.items() if kind == CLOUD and counts[t]], "LiDAR", notes
    )
    truth = wanted.get("truth") or _truth(types, counts, notes)
    return Topics(left, right, infos[0], infos[1], lidar, truth, tuple(notes))


def _pictures(
    types: Mapping[str, str], counts: Mapping[str, int], where: object, wanted: Mapping[str, str]
) -> tuple[str, str]:
    images = [
        topic
        for topic, kind in types.items()
        if kind in IMAGES and counts[topic] and not any(word in topic.lower() for word in _SKIPPED)
    ]
    if not images:
        known = ", ".join(sorted(types)[:8]) or "nothing"
        raise SourceError("no pictures in the bag", where, f"it has {known}")
    pairs = _pairs(images)
    for index, side in enumerate(("left", "right")):
        if side in wanted:
            pairs = [pair for pair in pairs if pair[index] == wanted[side]]
    if not pairs and len(images) == 2:
        pairs = [(min(images), max(images))]
    if not pairs:
        remedy = f"name them, ?left=TOPIC&right=TOPIC of {', '.join(sorted(images)[:12])}"
        raise SourceError("left and right pictures cannot be told apart", where, remedy)
    best = min(_rank(pair, types) for pair in pairs)
    first = [pair for pair in pairs if _rank(pair, types) == best]
    if len(first) > 1:
        remedy = f"name them, ?left=TOPIC&right=TOPIC: {', or '.join(' and '.join(p) for p in first[:4])}"
        raise SourceError("pictures of several pairs of cameras", where, remedy)
    return first[0]


def _pairs(images: list[str]) -> list[tuple[str, str]]:
    words: dict[str, dict[int, str]] = defaultdict(dict)
    numbers: dict[str, dict[int, str]] = defaultdict(dict)
    for topic in images:
        for i, part in enumerate(parts := topic.split("/")):
            side = side_of(part)
            if side is not None and side.token == "word":
                words["/".join([*parts[:i], side.rest, *parts[i + 1 :]])][side.index] = topic
                break
        else:
            for i, part in enumerate(parts):
                camera = camera_number(part)
                if camera is not None:
                    numbers["/".join([*parts[:i], camera[1], *parts[i + 1 :]])][camera[0]] = topic
                    break
    found = [(group[0], group[1]) for group in words.values() if len(group) == 2]
    for group in numbers.values():
        for a, b in ((0, 1), (2, 3), (1, 2)):
            if a in group and b in group:
                found.append((group[a], group[b]))
                break
    return found


def _rank(pair: tuple[str, str], types: Mapping[str, str]) -> tuple[int, int, int]:
    """Of several versions of one pair's pictures: rectified before raw, grey before colour, whole before packed."""
    name = pair[0].lower()
    rectified = 0 if "rect" in name else 1
    colour = 1 if "color" in name or "colour" in name or "rgb" in name else 0
    return rectified, colour, IMAGES.index(types[pair[0]])


def _info(topic: str, types: Mapping[str, str]) -> str | None:
    """The camera_info beside a topic of pictures."""
    parts = topic.split("/")
    infos = [name for name, kind in types.items() if kind == CAMERA_INFO]
    for depth in range(len(parts) - 1, 0, -1):
        home = "/".join(parts[:depth])
        direct = f"{home}/camera_info"
        if direct in infos:
            return direct
        inside = [name for name in infos if name.startswith(f"{home}/")]
        if len(inside) == 1 and depth > 1:
            return inside[0]
    return None


def _one_of(found: list[str], what: str, notes: list[str]) -> str | None:
    if len(found) > 1:
        notes.append(f"{what} topics {', '.join(sorted(found)[:4])}: none used, name one in the source")
    return found[0] if len(found) == 1 else None


def _truth(types: Mapping[str, str], counts: Mapping[str, int], notes: list[str]) -> str | None:
    """Whole poses before places only; of several of one kind those called truth."""
    for kinds in (POSES[:4], POSES[4:5], POSES[5:]):
        found = [topic for topic, kind in types.items() if kind in kinds and counts[topic]]
        named = [
            t for t in found if any(w in t.lower() for w in ("truth", "gt", "reference", "vicon", "mocap"))
        ]
        if len(named) == 1:
            return named[0]
        if found:
            return _one_of(found, "truth", notes)
    return None
