"""The town of the embedded drive, painted once for an installation and kept beside its compiled code.

To paint it takes two seconds, which is most of what `stereocalib demo` would wait for its first picture. What is kept
are the very numbers that were painted: arrays one behind the other, after a head in JSON that names them. The file
goes by the digest of the renderer, so that no other version reads it; what cannot be read is painted again.
"""

from __future__ import annotations

import contextlib
import json
import mmap
import os
import struct
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereocalib_core import simulator
from stereocalib_core.simulator.drive import Drive
from stereocalib_core.simulator.furniture import Instance
from stereocalib_core.simulator.meshes import Mesh
from stereocalib_core.simulator.settings import DriveSettings
from stereocalib_core.simulator.studio import Studio
from stereocalib_core.simulator.textures import Atlas
from stereocalib_core.simulator.world import World
from stereocalib_core.system.user_cache import user_cache

_MAGIC = b"SCW1"
_ALIGN = 64
_KINDS = ("<f8", "<i8", "<i4", "|u1")


def is_town(settings: DriveSettings) -> bool:
    """Whether the world of a drive is that of the embedded one: its length and most faults change nothing in it."""
    ramps = any(fault.kind == "ramp" for fault in settings.faults)
    return not ramps and replace(settings, frames=None, faults=()) == DriveSettings()


def places(version: str) -> list[Path]:
    """Where the town of a renderer is looked for: with the installation, else with the user's caches."""
    name = f"town-{version}.world"
    return [Path(simulator.__file__).parent / "__pycache__" / name, user_cache() / name]


def open_town(studio: Studio, version: str) -> None:
    """Give a studio its town where that is kept; else it paints it when the first picture is asked for."""
    if not is_town(studio.settings):
        return
    for path in places(version):
        world = read_world(path, studio.drive)
        if world is not None:
            studio.__dict__["world"] = world
            return


def keep_town(version: str) -> None:
    """Paint the town where it is not kept yet; where nothing can be written it is painted every time."""
    keep_painted(Studio(DriveSettings()), version)


def keep_painted(studio: Studio, version: str) -> None:
    """Keep the town of a studio for who comes after, where it is one and is not kept yet."""
    if is_town(studio.settings) and not any(path.is_file() for path in places(version)):
        for path in places(version):
            with contextlib.suppress(OSError):
                write_world(path, studio.world)
                for other in set(path.parent.glob("town-*.world")) - {path}:
                    other.unlink()
                return


def write_world(path: Path, world: World) -> None:
    """A world to a file that is there whole or not at all; raises OSError."""
    things = world.standing
    arrays: dict[str, NDArray[Any]] = {f"mesh.{f.name}": getattr(world.mesh, f.name) for f in fields(Mesh)}
    arrays |= {f"atlas.{f.name}": getattr(world.atlas, f.name) for f in fields(Atlas)}
    arrays |= {
        "rows_s_m": world.rows_s_m,
        "positions": world.positions,
        "radii": world.radii,
        "things.position": np.array([t.position for t in things], dtype=np.float64).reshape(-1, 3),
        "things.rotation": np.array([t.rotation for t in things], dtype=np.float64).reshape(-1, 3, 3),
        "things.tone_s_m": np.array([(t.tone, t.s_m) for t in things], dtype=np.float64).reshape(-1, 2),
    }
    offset, table = 0, {}
    for name, array in arrays.items():
        table[name] = [offset, array.dtype.str, list(array.shape)]
        offset += -(-array.nbytes // _ALIGN) * _ALIGN
    head = {
        "arrays": table,
        "bytes": offset,
        "kinds": [t.kind for t in things],
        "templates": world.templates,
        "ground_row_triangles": world.ground_row_triangles,
        "rest": world.rest,
        "map_texel_m": world.map_texel_m,
    }
    text = json.dumps(head).encode()
    path.parent.mkdir(parents=True, exist_ok=True)
    growing = path.with_name(f".{path.name}-{os.getpid()}")
    try:
        with growing.open("wb") as file:
            file.write(_MAGIC + struct.pack("<I", len(text)) + text)
            file.write(bytes(_begin(len(text)) - file.tell()))
            for array in arrays.values():
                data = np.ascontiguousarray(array).tobytes()
                file.write(data + bytes(-len(data) % _ALIGN))
        growing.replace(path)
    finally:
        growing.unlink(missing_ok=True)


def _begin(length: int) -> int:
    """Where the arrays begin behind a head of so many bytes."""
    return -(-(len(_MAGIC) + 4 + length) // _ALIGN) * _ALIGN


def read_world(path: Path, drive: Drive) -> World | None:
    """The world of a drive from its file, read as far as it is looked at; None where it is not there whole."""
    try:
        with path.open("rb") as file:
            magic, length = file.read(len(_MAGIC)), struct.unpack("<I", file.read(4))[0]
            head = json.loads(file.read(length))
            begin, end = _begin(length), os.fstat(file.fileno()).st_size
            if magic != _MAGIC or end != begin + head["bytes"]:
                return None
            # for this process alone, so that arrays may be written to like any others
            data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY)
        found = {name: _array(data, begin, *place) for name, place in head["arrays"].items()}
        things = zip(
            head["kinds"],
            found["things.position"],
            found["things.rotation"],
            found["things.tone_s_m"].tolist(),
            strict=True,
        )
        return World(
            Mesh(*(found[f"mesh.{f.name}"] for f in fields(Mesh))),
            Atlas(*(found[f"atlas.{f.name}"] for f in fields(Atlas))),
            head["ground_row_triangles"],
            found["rows_s_m"],
            (head["rest"][0], head["rest"][1]),
            {kind: (first, last, radius) for kind, (first, last, radius) in head["templates"].items()},
            tuple(Instance(kind, at, turned, tone, s_m) for kind, at, turned, (tone, s_m) in things),
            found["positions"],
            found["radii"],
            head["map_texel_m"],
            drive,
        )
    except (OSError, ValueError, KeyError, TypeError, IndexError, struct.error):
        return None


def _array(data: mmap.mmap, begin: int, offset: int, kind: str, shape: list[int]) -> NDArray[Any]:
    if kind not in _KINDS:
        raise ValueError(kind)
    return np.ndarray(tuple(shape), np.dtype(kind), data, begin + offset)
