"""`bag:FILE[?left=TOPIC&right=TOPIC&lidar=TOPIC&truth=TOPIC]`: a ROS 1 bag, a ROS 2 bag or an MCAP file.

Read through `rosbags`. Only the index is read at once; pictures are read when they are asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stereocalib_core.calibration import StereoCalibration
from stereocalib_core.config.reading import LOOKED_AT
from stereocalib_core.errors import Failure, FailureReason, SourceError
from stereocalib_core.frames import Recording, StereoFrame
from stereocalib_core.geometry import Array
from stereocalib_core.sources.assembly import Load, rectifying, truth_of_rectified, turned, unit_of
from stereocalib_core.sources.bags import messages
from stereocalib_core.sources.bags.beside import FixedFrames, entry_ns, truth_of, with_clouds
from stereocalib_core.sources.bags.reader import Bag
from stereocalib_core.sources.bags.storages import Entry
from stereocalib_core.sources.bags.topics import Topics, choose
from stereocalib_core.sources.calibrations import Found, read_calibration, ros
from stereocalib_core.sources.calibrations.rectify import opened
from stereocalib_core.sources.format import Format, SourceKind, Spec
from stereocalib_core.sources.pairing import content_key
from stereocalib_core.sources.pictures import UnreadablePicture, to_8_bit
from stereocalib_core.sources.times import since_epoch

KEYS = ("left", "right", "lidar", "truth", "left_info", "right_info", "calibration", "camera", "unit")
SUFFIXES = (".bag", ".mcap", ".db3")


def _accepts(spec: Spec) -> bool:
    path = spec.path
    if spec.scheme == "bag":
        return True
    if spec.scheme or path is None:
        return False
    return (path.is_file() and path.suffix.lower() in SUFFIXES) or (path / "metadata.yaml").is_file()


def _open(spec: Spec) -> Recording:
    unknown = [key for key in spec.options if key not in KEYS]
    if spec.path is None or unknown:
        keys = "left, right, lidar, truth or calibration"
        raise SourceError(
            "bad bag source", spec.text, f"write bag:FILE?left=TOPIC&right=TOPIC, keys are {keys}"
        )
    bag = Bag(spec.path)
    topics = choose(bag.types, bag.counts, spec.options, spec.path)
    left, right = bag.entries(topics.left), bag.entries(topics.right)
    pairs, notices = paired(left, right)
    if not pairs:
        raise SourceError("no left picture has a right one of its time", spec.path, "check the topics")
    times_s, epoch_s = since_epoch([entry_ns(entry) for entry, _ in pairs], 10**9)
    size, bits = _survey(bag, topics, pairs, spec.path)
    found = _calibration(bag, topics, spec)
    ready = opened(found.calibration, size, spec.path)
    notices = [*topics.notes, *notices, *ready.notes]
    if any(entry.header_ns is None for entry, _ in pairs[:1]):
        notices.append("packed messages: all times are those of the recording, not of the sensors")
    load: Load = _Reader(bag, topics, pairs, times_s, size, bits)
    if ready.rectifier is not None:
        load = rectifying(load, ready.rectifier)
    frames = FixedFrames(bag)
    camera_frame = frames.of(topics.left)
    T_camera_lidar = None
    if topics.lidar is not None:
        T = frames.between(camera_frame, frames.of(topics.lidar))
        if T is None:
            notices.append(
                f"{topics.lidar} without a transform to {camera_frame or 'the camera'}: left unused"
            )
        else:
            T_camera_lidar = turned(T, ready)
            load, note = with_clouds(load, bag, topics.lidar, epoch_s + times_s)
            notices += note
    truth, truth_notices = truth_of(bag, topics, frames, camera_frame, epoch_s + times_s)
    return Recording(
        name=spec.path.stem if spec.path.is_file() else spec.path.name,
        camera=ready.camera,
        timestamps_s=times_s,
        load=load,
        ground_truth=truth_of_rectified(truth, ready),
        notices=(*notices, *truth_notices),
        T_camera_lidar=T_camera_lidar,
        content_key=content_key("bag", [*bag.files, *found.files], topics),
        calibration=found.calibration,
        epoch_s=epoch_s,
    )


def paired(
    left: Sequence[Entry], right: Sequence[Entry]
) -> tuple[list[tuple[Entry, Entry | None]], list[str]]:
    """Every left picture with the right one nearest in time, within half a period; None where there is none.

    Right pictures without a left one are counted; so are left ones before the first and after the last pair, which
    are left out.
    """
    if not left or not right:
        return [], []
    left, right = sorted(left, key=entry_ns), sorted(right, key=entry_ns)
    times = np.array([entry_ns(e) - entry_ns(left[0]) for e in left], dtype=np.float64)
    others = np.array([entry_ns(e) - entry_ns(left[0]) for e in right], dtype=np.float64)
    period = float(np.median(np.diff(times))) if len(times) > 1 else np.inf
    owner: dict[int, tuple[float, int]] = {}
    for i, moment in enumerate(times):
        spot = int(np.searchsorted(others, moment))
        best = min(
            (j for j in (spot - 1, spot) if 0 <= j < len(others)), key=lambda j: abs(others[j] - moment)
        )
        distance = abs(float(others[best] - moment))
        if distance <= period / 2 and distance < owner.get(best, (np.inf, -1))[0]:
            owner[best] = (distance, i)
    partner = {i: best for best, (_, i) in owner.items()}
    if not partner:
        return [], []
    first, last = min(partner), max(partner)
    pairs = [(left[i], right[partner[i]] if i in partner else None) for i in range(first, last + 1)]
    notices = []
    lone = sum(second is None for _, second in pairs)
    outside = len(left) - len(pairs)
    for count, text in (
        (lone, "left pictures inside the recording have no right one"),
        (outside, "left pictures before the first or after the last pair are left out"),
        (len(right) - len(partner), "right pictures have no left one and are left out"),
    ):
        if count:
            notices.append(f"{count} {text}")
    return pairs, notices


def _survey(
    bag: Bag, topics: Topics, pairs: Sequence[tuple[Entry, Entry | None]], where: Path
) -> tuple[tuple[int, int], int]:
    """(width, height) of the pictures and the bits of grey that they use."""
    peak, size, last = 0, None, "check the topics"
    for i in sorted({int(i) for i in np.linspace(0, len(pairs) - 1, LOOKED_AT).round()}):
        try:
            image = messages.picture(bag.message(topics.left, pairs[i][0]))
        except UnreadablePicture as error:
            last = str(error)
            continue
        size = size or (image.shape[1], image.shape[0])
        peak = max(peak, int(image.max()) if image.dtype == np.uint16 else 0)
    if size is None:
        raise SourceError("no picture can be read", where, last)
    return size, max(8, -(-peak.bit_length() // 2) * 2)


def _calibration(bag: Bag, topics: Topics, spec: Spec) -> Found:
    named = spec.options.get("calibration") or spec.options.get("camera")
    if named:
        return read_calibration(named, unit_of(spec.options))
    if topics.left_info is None or topics.right_info is None:
        side = "left" if topics.left_info is None else "right"
        remedy = f"no camera_info of the {side} camera; name a calibration by --calibration"
        raise SourceError("bag without a calibration", spec.path, remedy)
    infos = []
    for topic in (topics.left_info, topics.right_info):
        entries = bag.entries(topic)
        if not entries:
            raise SourceError(f"{topic} is empty", spec.path, "name a calibration by --calibration")
        infos.append(messages.camera_info(bag.message(topic, entries[0])))
    calibration = ros.from_infos(infos[0], infos[1], f"{spec.path}, {topics.left_info}")
    if topics.rectified and calibration.rectified is not None:
        calibration = StereoCalibration(
            calibration.lenses,
            calibration.rectified,
            False,
            None,
            None,
            calibration.notes,
            calibration.dialect,
        )
    return Found(calibration, ())


@dataclass(frozen=True, eq=False)
class _Reader:
    bag: Bag
    topics: Topics
    pairs: Sequence[tuple[Entry, Entry | None]]
    times_s: Array
    size: tuple[int, int]
    bits: int

    def __call__(self, index: int) -> StereoFrame:
        """The pair at `index`; a damaged or missing side becomes its failure."""
        time_s = float(self.times_s[index])
        sides: list[Any] = []
        entries = zip(
            ("left", "right"), (self.topics.left, self.topics.right), self.pairs[index], strict=True
        )
        for side, topic, entry in entries:
            found = self._side(side, topic, entry)
            if isinstance(found, Failure):
                return StereoFrame(index, time_s, None, None, found)
            sides.append(found)
        return StereoFrame(index, time_s, sides[0], sides[1])

    def _side(self, side: str, topic: str, entry: Entry | None) -> Any:
        if entry is None:
            return Failure(FailureReason.MISSING_PAIR, f"no {side} picture of this time")
        try:
            image = to_8_bit(messages.picture(self.bag.message(topic, entry)), self.bits)
        except (UnreadablePicture, SourceError) as error:
            return Failure(FailureReason.UNREADABLE, f"{side} picture of {topic}: {error}")
        if (image.shape[1], image.shape[0]) != self.size:
            detail = f"{side} picture is {image.shape[1]}x{image.shape[0]}, the camera {self.size[0]}x{self.size[1]}"
            return Failure(FailureReason.SIZE_MISMATCH, detail)
        return image


FORMAT = Format("ROS bag or MCAP", _accepts, _open, SourceKind.BAG)
