"""One finished frame as bytes and back, bit for bit: a JSON part and the raw arrays that it describes."""

from __future__ import annotations

import json
import math
import struct
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.errors import Failure, FailureReason
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.numeric.spill import Shelf
from stereocalib_core.results import (
    Check,
    FrameResult,
    FrontEndMemory,
    OwnCarMemory,
    RectificationSample,
    RoadEstimate,
    RoadResidual,
    ScanSample,
    Tracks,
)
from stereocalib_core.results.own_car import own_car_columns, own_car_of


@dataclass(frozen=True, slots=True)
class Done:
    """A finished frame: its result, what the front end remembered after it, and how long it took."""

    result: FrameResult
    memory: FrontEndMemory
    total_ms: float


_KINDS = {kind: np.dtype(kind) for kind in ("<f8", "<f4", "<i2", "|b1")}


class _Arrays:
    """Arrays put aside while the rest goes into JSON, which gets their place, type and shape."""

    def __init__(self, data: bytes = b"") -> None:
        self.data = bytearray(data)

    def put(self, array: NDArray[Any] | None) -> Any:
        if array is None:
            return None
        place = [len(self.data), array.dtype.str, list(array.shape)]
        self.data += np.ascontiguousarray(array).tobytes()
        return place

    def get(self, place: Any) -> Any:
        if place is None:
            return None
        offset, kind, shape = place
        if kind not in _KINDS:
            raise ValueError(kind)
        count = math.prod(shape)
        if count > len(self.data):
            raise ValueError(count)
        return np.frombuffer(self.data, _KINDS[kind], count, offset).reshape(shape).copy()


def pack(done: Done) -> bytes:
    """A finished frame to bytes: the length of a JSON part, the JSON, and the arrays that it names."""
    r, arrays = done.result, _Arrays()
    road, sample, tracks = r.road, r.rectification, r.tracks
    values = {
        "frame": r.frame,
        "timestamp_s": r.timestamp_s,
        "road": None
        if road is None
        else [
            asdict(road.extrinsics),
            arrays.put(road.covariance),
            road.inliers,
            road.free_fraction,
            list(road.range_m),
            list(road.bend),
            road.crossfall_rad,
            list(road.along),
            list(road.alone),
        ],
        "failure": None if r.failure is None else [str(r.failure.reason), r.failure.detail],
        "free_fraction": r.free_fraction,
        "inliers": r.inliers,
        "rectification": None
        if sample is None
        else [arrays.put(sample.values), arrays.put(sample.covariance), sample.matches, sample.keystone_rad],
        "tracks": None
        if tracks is None
        else [
            *(arrays.put(tracks.points), arrays.put(tracks.on_road), tracks.previous),
            None if tracks.lean is None else arrays.put(tracks.lean),
        ],
        "checks": [asdict(check) for check in r.checks],
        "timing_ms": dict(r.timing_ms),
        "lidar": None
        if r.lidar is None
        else [arrays.put(r.lidar.values), arrays.put(r.lidar.covariance), r.lidar.points],
        "scan": None
        if r.scan is None
        else [
            arrays.put(r.scan.T_camera_lidar),
            arrays.put(r.scan.packed_beam_edges),
            arrays.put(r.scan.packed_picture_edges),
            arrays.put(r.scan.packed_points),
            arrays.put(r.scan.packed_patches),
            None if np.isnan(r.scan.sweep) else r.scan.sweep,
        ],
        "disparities": arrays.put(r.disparities),
        "memory": [
            *(done.memory.tracked, arrays.put(done.memory.motion)),
            own_car_columns(done.memory.own_car, arrays.put),
        ],
        "total_ms": done.total_ms,
    }
    text = json.dumps(values, default=_number).encode()
    return struct.pack("<I", len(text)) + text + bytes(arrays.data)


def _number(value: Any) -> Any:
    """numpy scalars to the Python numbers they equal."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(type(value).__name__)


def _scan_sample(arrays: _Arrays, stored: Sequence[Any]) -> ScanSample:
    T, beams, edges, points, patches = (arrays.get(place) for place in stored[:5])
    return ScanSample(T, beams, edges, points, patches, float("nan") if stored[5] is None else stored[5])


_WORDS: dict[tuple[tuple[str, str, str], ...], tuple[tuple[str, str, str], ...]] = {}


def _limit(packed: float) -> float | None:
    return None if math.isnan(packed) else packed


class _Checks(Sequence[Check]):
    """The checks of one frame: their words are shared by all frames that have the same, their numbers are packed.

    A long drive has hundreds of thousands of checks, and hardly anyone looks at one of them.
    """

    __slots__ = ("_numbers", "_words")

    def __init__(self, stored: Sequence[Mapping[str, Any]]) -> None:
        words = tuple((c["stage"], c["name"], c["unit"]) for c in stored)
        self._words = _WORDS.setdefault(words, words)
        numbers = (math.nan if c[key] is None else c[key] for c in stored for key in ("value", "low", "high"))
        self._numbers = struct.pack(f"<{3 * len(words)}d", *numbers)

    def __len__(self) -> int:
        return len(self._words)

    @overload
    def __getitem__(self, index: int) -> Check: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[Check, ...]: ...

    def __getitem__(self, index: int | slice) -> Check | tuple[Check, ...]:
        if isinstance(index, slice):
            return tuple(self[i] for i in range(*index.indices(len(self))))
        i = range(len(self))[index]
        stage, name, unit = self._words[i]
        value, low, high = struct.unpack_from("<3d", self._numbers, 24 * i)
        return Check(stage, name, value, _limit(low), _limit(high), unit)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and tuple(self) == tuple(other)

    def __hash__(self) -> int:
        return hash(tuple(self))


def _tracks(keep: Callable[[Any], Any], stored: Sequence[Any]) -> Tracks:
    # runs of earlier versions have no lean
    lean = None if len(stored) < 4 or stored[3] is None else keep(stored[3])
    return Tracks(keep(stored[0]), keep(stored[1]), stored[2], lean)


def unpack(payload: bytes, shelf: Shelf | None = None) -> Done:
    """The frame that `pack` wrote, bit for bit; raises what json, struct and the types raise for damaged bytes.

    shelf: where the tracks are put, and what is known of the own car, of a drive whose frames are all kept.
    """

    def keep(place: Any) -> Any:
        array = arrays.get(place)
        return array if shelf is None or array is None else shelf.put(array)

    (length,) = struct.unpack_from("<I", payload)
    values = json.loads(payload[4 : 4 + length])
    arrays = _Arrays(payload[4 + length :])
    road, failure = values["road"], values["failure"]
    sample, tracks, memory = values["rectification"], values["tracks"], values["memory"]
    lidar, scan = values["lidar"], values["scan"]
    result = FrameResult(
        values["frame"],
        values["timestamp_s"],
        None
        if road is None
        else RoadEstimate(
            Extrinsics(**road[0]),
            arrays.get(road[1]),
            road[2],
            road[3],
            (road[4][0], road[4][1]),
            (road[5][0], road[5][1]),
            road[6],
            (road[7][0], road[7][1]),
            # runs of earlier versions have it in what goes before
            (road[8][0], road[8][1]) if len(road) > 8 else (0.0, 0.0),
        ),
        None if failure is None else Failure(FailureReason(failure[0]), failure[1]),
        values["free_fraction"],
        values["inliers"],
        None
        if sample is None
        else RectificationSample(arrays.get(sample[0]), arrays.get(sample[1]), sample[2], sample[3]),
        None if tracks is None else _tracks(keep, tracks),
        _Checks(values["checks"]),
        MappingProxyType({sys.intern(stage): ms for stage, ms in values["timing_ms"].items()}),
        None if lidar is None else RoadResidual(arrays.get(lidar[0]), arrays.get(lidar[1]), lidar[2]),
        None if scan is None else _scan_sample(arrays, scan),
        arrays.get(values["disparities"]),
    )
    # runs of earlier versions did not look for the own car
    own_car = own_car_of(memory[2], keep) if len(memory) > 2 else OwnCarMemory()
    return Done(result, FrontEndMemory(memory[0], arrays.get(memory[1]), own_car), values["total_ms"])
