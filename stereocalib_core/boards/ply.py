"""Stanford PLY files, ascii and binary: the vertex element's x, y, z."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stereocalib_core.config.boards_search import CLOUD_FILE
from stereocalib_core.errors import SourceError
from stereocalib_core.numeric.arrays import Array

TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


def read(path: Path) -> Array:
    """A PLY file to (N, 3) raw points [m]; vertices must be its first element."""
    raw = path.read_bytes()
    end = raw.find(b"end_header", 0, CLOUD_FILE.longest_header_bytes)
    if not raw.startswith(b"ply") or end < 0:
        raise SourceError("cloud has no PLY header", path, "the file is cut off or of another kind")
    body = raw[raw.index(b"\n", end) + 1 :] if b"\n" in raw[end : end + 16] else b""
    kind, count, properties = _parse_header(raw[:end].decode("ascii", errors="replace"), path)
    names = [name for name, _ in properties]
    if not set("xyz") <= set(names):
        raise SourceError("cloud has no x, y, z", path, f"properties are {' '.join(names)[:120]}")
    if kind == "ascii":
        tokens = body.split()
        if len(tokens) < count * len(names):
            raise SourceError(
                "cloud is cut off", path, f"holds {len(tokens) // len(names)} of {count} points"
            )
        values = np.array(tokens[: count * len(names)], dtype="S32").reshape(-1, len(names))
        return values[:, [names.index(axis) for axis in "xyz"]].astype(np.float64)
    layout = np.dtype([(f"f{i}", ORDERS[kind] + t) for i, (_, t) in enumerate(properties)])
    if len(body) < count * layout.itemsize:
        raise SourceError("cloud is cut off", path, f"holds {len(body) // layout.itemsize} of {count} points")
    records = np.frombuffer(body, dtype=layout, count=count)
    return np.stack([records[f"f{names.index(axis)}"].astype(np.float64) for axis in "xyz"], axis=1)


def _parse_header(text: str, path: Path) -> tuple[str, int, list[tuple[str, str]]]:
    """Format, number of vertices and the vertex properties as (name, numpy type)."""
    kind, count, element = "", -1, ""
    properties: list[tuple[str, str]] = []
    try:
        for words in (line.split() for line in text.splitlines()):
            if not words:
                continue
            if words[0] == "format":
                kind = words[1]
            elif words[0] == "element":
                element = words[1]
                if count < 0 and element != "vertex":
                    raise SourceError(
                        "PLY does not begin with its vertices", path, "write the cloud as points only"
                    )
                count = int(words[2]) if element == "vertex" else count
            elif words[0] == "property" and element == "vertex":
                name = words[2].lower() if words[2] in ("X", "Y", "Z") else words[2]
                properties.append((name, TYPES[words[1]]))
    except (IndexError, KeyError, ValueError) as error:
        raise SourceError("PLY header is damaged", path, f"{type(error).__name__} {error}") from error
    if kind not in ORDERS or count < 0 or not properties:
        raise SourceError("PLY header is damaged", path, "it names no format or no vertices")
    return kind, count, properties
