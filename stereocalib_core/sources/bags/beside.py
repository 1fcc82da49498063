"""What a bag holds beside its pictures: fixed transforms, LiDAR scans, and poses or places as truth."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from stereocalib_core.config.reading import MOST_POSES_OF_A_BAG, UNSTATED_FPS
from stereocalib_core.errors import SourceError
from stereocalib_core.frames import GroundTruth, StereoFrame
from stereocalib_core.geometry import Array, invert_transform, transform
from stereocalib_core.sources.assembly import Load
from stereocalib_core.sources.bags import messages
from stereocalib_core.sources.bags.reader import Bag
from stereocalib_core.sources.bags.storages import Entry
from stereocalib_core.sources.bags.topics import Topics
from stereocalib_core.sources.lists import NO_POSES, from_first
from stereocalib_core.sources.truth import forward_axes, interpolated


def entry_ns(entry: Entry) -> int:
    """The camera's own time of a message, else that of the recording [ns]."""
    return entry.log_ns if entry.header_ns is None else entry.header_ns


class FixedFrames:
    """The fixed transforms of /tf_static, as a graph of frames."""

    def __init__(self, bag: Bag) -> None:
        self._bag = bag
        self._edges: dict[str, dict[str, Array]] = {}
        for topic, kind in bag.types.items():
            if kind != messages.TF_STATIC or "static" not in topic:
                continue
            for entry in bag.entries(topic)[:1000]:
                try:
                    message = bag.message(topic, entry)
                except SourceError:
                    continue
                for one in message.transforms:
                    T = messages.rigid(one.transform)
                    a, b = (str(name).lstrip("/") for name in (one.header.frame_id, one.child_frame_id))
                    if np.isfinite(T).all():
                        self._edges.setdefault(a, {})[b] = T
                        self._edges.setdefault(b, {})[a] = invert_transform(T)

    def of(self, topic: str) -> str:
        """The frame that a topic's messages are in."""
        entries = self._bag.entries(topic)
        try:
            return str(self._bag.message(topic, entries[0]).header.frame_id).lstrip("/") if entries else ""
        except (SourceError, AttributeError):
            return ""

    def between(self, a: str, b: str) -> Array | None:
        """(4, 4) T_a_b over any number of fixed transforms; None where they do not join the two."""
        if a == b and a:
            return np.eye(4)
        reached = {a: np.eye(4)}
        waiting = [a]
        while waiting:
            here = waiting.pop(0)
            for there, T in self._edges.get(here, {}).items():
                if there not in reached:
                    reached[there] = reached[here] @ T
                    waiting.append(there)
        return reached.get(b)


def with_clouds(load: Load, bag: Bag, topic: str, times_s: Array) -> tuple[Load, list[str]]:
    """The same reader with the scan nearest in time, within half of the scans' own period."""
    entries = sorted(bag.entries(topic), key=entry_ns)
    moments = np.array([entry_ns(entry) / 1e9 for entry in entries])
    period = float(np.median(np.diff(moments))) if len(moments) > 1 else 1 / UNSTATED_FPS
    chosen: list[Entry | None] = []
    for time_s in times_s:
        nearest = int(np.argmin(np.abs(moments - time_s))) if len(moments) else -1
        close = nearest >= 0 and abs(moments[nearest] - time_s) <= period / 2
        chosen.append(entries[nearest] if close else None)

    def load_with_cloud(index: int) -> StereoFrame:
        frame, entry = load(index), chosen[index]
        if entry is None:
            return frame
        try:
            return dataclasses.replace(frame, lidar=messages.cloud(bag.message(topic, entry)))
        except SourceError:
            return frame

    count = sum(entry is not None for entry in chosen)
    return load_with_cloud, [] if count == len(chosen) else [
        f"LiDAR scans for {count} of {len(chosen)} frames"
    ]


def truth_of(
    bag: Bag, topics: Topics, frames: FixedFrames, camera_frame: str, times_s: Array
) -> tuple[GroundTruth | None, list[str]]:
    """The truth of a topic at the frames' times, and what to know of it."""
    if topics.truth is None:
        return None, [NO_POSES]
    kind = bag.types[topics.truth]
    try:
        stamps, given, body, fixes = _poses(bag, topics.truth, kind)
    except (SourceError, AttributeError) as error:
        return None, [f"truth of {topics.truth} is not used: {error}", NO_POSES]
    notices = [f"truth from {topics.truth} ({kind.rpartition('/')[2]})"]
    if len(stamps) == 0:
        return None, [f"{topics.truth} holds no pose", NO_POSES]
    if fixes:
        notices.append("truth of places only: judged by path length, its heading is that of the way driven")
        poses = interpolated(given, stamps, times_s)
    else:
        poses = interpolated(given, stamps, times_s)
        T_body_camera = frames.between(body, camera_frame) if body else None
        if T_body_camera is not None:
            poses = poses @ T_body_camera
        elif (R := forward_axes(poses)) is not None:
            poses = poses @ transform(R, np.zeros(3))
            notices.append("its poses travel along their x: taken as a vehicle's, x ahead and z up")
    known = int(np.isfinite(poses).all(axis=(1, 2)).sum())
    if known == 0:
        return None, [*notices, "the truth has no time in common with the pictures", NO_POSES]
    if known < len(times_s):
        notices.append(f"truth for {known} of {len(times_s)} frames")
    return GroundTruth(poses=from_first(poses), heading_reliable=not fixes), notices


def _poses(bag: Bag, topic: str, kind: str) -> tuple[Array, Array, str, bool]:
    """Stamps [s], T_world_body (N, 4, 4), the body's frame, and whether they are places without a heading."""
    entries = bag.entries(topic)[:MOST_POSES_OF_A_BAG]
    stamps: list[float] = []
    poses: list[Any] = []
    body = ""
    name = kind.rpartition("/")[2]
    if name == "Path":
        message = bag.message(topic, entries[-1])
        for one in message.poses:
            stamps.append(one.header.stamp.sec + one.header.stamp.nanosec / 1e9)
            poses.append(messages.rigid(one.pose))
        return np.array(stamps), np.array(poses).reshape(-1, 4, 4), body, False
    for entry in entries:
        message = bag.message(topic, entry)
        stamp = message.header.stamp
        ns = stamp.sec * 10**9 + stamp.nanosec
        stamps.append((entry_ns(entry) if entry.header_ns is None or not ns else ns) / 1e9)
        if name == "NavSatFix":
            fix = message.status.status >= 0
            poses.append([message.latitude, message.longitude, message.altitude] if fix else [np.nan] * 3)
            continue
        if name == "TransformStamped":
            pose: Any = message.transform
        else:
            pose = message.pose.pose if hasattr(message.pose, "pose") else message.pose
        poses.append(messages.rigid(pose))
        body = str(getattr(message, "child_frame_id", "")).lstrip("/")
    if name == "NavSatFix":
        fixes = np.array(poses, dtype=np.float64).reshape(-1, 3)
        fixes[:, 2] = np.where(np.isfinite(fixes[:, 2]) | ~np.isfinite(fixes[:, 0]), fixes[:, 2], 0.0)
        return np.array(stamps), messages.navsat_poses(fixes), "", True
    return np.array(stamps), np.array(poses).reshape(-1, 4, 4), body, False
