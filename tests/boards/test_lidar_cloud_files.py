"""Every cloud format, whole, cut off and hostile."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from stereocalib_core.boards.cloud_files import read_cloud
from stereocalib_core.errors import SourceError

POINTS = np.random.default_rng(3).uniform(-9, 9, (60, 3)).astype(np.float32)
HEADER = (
    "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z intensity ring\nSIZE 4 4 4 4 2\nTYPE F F F F U\nCOUNT 1 1 1 1 1\n"
    "WIDTH {n}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA {kind}\n"
)

BOMB = struct.pack("<II", 9, 18 * 10**8) + b"\0" * 9


def pcd_ascii(n: int = 60) -> bytes:
    rows = "".join(f"{x:.9g} {y:.9g} {z:.9g} 7 3\n" for x, y, z in POINTS)
    return (HEADER.format(n=n, kind="ascii") + rows).encode()


def pcd_binary(n: int = 60) -> bytes:
    body = b"".join(struct.pack("<ffffH", *p, 7.0, 3) for p in POINTS)
    return HEADER.format(n=n, kind="binary").encode() + body


def pcd_compressed(n: int = 60) -> bytes:
    columns = POINTS.T.copy().tobytes() + np.full(60, 7, "<f4").tobytes() + np.full(60, 3, "<u2").tobytes()
    # The ring column repeats with period 2: one copy from 2 bytes back replaces its last 118 bytes.
    literal = columns[:-118]
    packed = b"".join(
        bytes([len(c) - 1]) + c for c in (literal[i : i + 32] for i in range(0, len(literal), 32))
    )
    packed += bytes([7 << 5, 118 - 2 - 7, 1])
    return (
        HEADER.format(n=n, kind="binary_compressed").encode()
        + struct.pack("<II", len(packed), len(columns))
        + packed
    )


def ply(kind: str) -> bytes:
    head = (
        f"ply\nformat {kind} 1.0\nelement vertex 60\nproperty float x\nproperty float y\nproperty float z\n"
    )
    head += "property uchar tag\nend_header\n"
    if kind == "ascii":
        return head.encode() + "".join(f"{x:.9g} {y:.9g} {z:.9g} 1\n" for x, y, z in POINTS).encode()
    order = "<" if "little" in kind else ">"
    return head.encode() + b"".join(struct.pack(order + "fffB", *p, 1) for p in POINTS)


def csv(separator: str, header: str = "") -> bytes:
    return (header + "".join(f"{x:.9g}{separator}{y:.9g}{separator}{z:.9g}\n" for x, y, z in POINTS)).encode()


FILES = {
    "a.pcd": pcd_ascii(),
    "b.pcd": pcd_binary(),
    "c.pcd": pcd_compressed(),
    "d.bin": np.column_stack([POINTS, np.ones(60, np.float32)]).astype("<f4").tobytes(),
    "e.ply": ply("ascii"),
    "f.ply": ply("binary_little_endian"),
    "g.ply": ply("binary_big_endian"),
    "h.csv": csv(",", "x,y,z\n"),
    "i.xyz": csv(" ", "# a comment\n"),
    "j.csv": csv(";"),
}


@pytest.mark.parametrize("name", FILES)
def test_every_format_gives_the_same_points(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(FILES[name])
    np.testing.assert_allclose(read_cloud(tmp_path / name), POINTS, rtol=1e-6)


def test_named_columns_are_found_in_any_order(tmp_path: Path) -> None:
    rows = "".join(f"5,{z:.9g},{x:.9g},{y:.9g}\n" for x, y, z in POINTS)
    (tmp_path / "a.csv").write_text("intensity,z,x,y\n" + rows)
    np.testing.assert_allclose(read_cloud(tmp_path / "a.csv"), POINTS, rtol=1e-6)


def test_npy_plain_and_structured(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.column_stack([POINTS, np.ones(60)]))
    records = np.zeros(60, dtype=[("t", "f8"), ("x", "f4"), ("y", "f4"), ("z", "f4")])
    records["x"], records["y"], records["z"] = POINTS.T
    np.save(tmp_path / "b.npy", records)
    for name in ("a.npy", "b.npy"):
        np.testing.assert_allclose(read_cloud(tmp_path / name), POINTS, rtol=1e-6)


def test_no_returns_are_dropped(tmp_path: Path) -> None:
    points = np.vstack(
        [POINTS, np.full((5, 3), np.nan), np.zeros((5, 3)), np.full((3, 3), np.inf), [[1e30, 0, 0]]]
    )
    np.save(tmp_path / "a.npy", points.astype(np.float32))
    assert len(read_cloud(tmp_path / "a.npy")) == 60


@pytest.mark.parametrize("name", ["a.pcd", "b.pcd", "c.pcd", "e.ply", "f.ply"])
def test_cut_off_files_are_refused_in_one_line(tmp_path: Path, name: str) -> None:
    raw = FILES[name]
    for keep in (len(raw) - 27, len(raw) // 2, 40, 0):
        (tmp_path / name).write_bytes(raw[:keep])
        with pytest.raises(SourceError) as error:
            read_cloud(tmp_path / name)
        assert "\n" not in str(error.value)
        assert str(tmp_path / name) in str(error.value)


@pytest.mark.parametrize(
    ("name", "raw"),
    [
        ("a.pcd", HEADER.format(n=10**15, kind="binary").encode() + b"\0" * 100),
        ("b.pcd", HEADER.format(n=-4, kind="binary").encode()),
        ("c.pcd", HEADER.format(n=10**8, kind="binary_compressed").encode() + BOMB),
        ("d.pcd", b"FIELDS x y\nSIZE 4 4\nTYPE F F\nCOUNT 1 1\nPOINTS 1\nDATA ascii\n1 2\n"),
        ("e.pcd", b"\x89PNG\r\n" * 50),
        ("f.ply", b"ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\nend_header\n"),
        ("g.npy", b"not numpy at all"),
        ("h.csv", b"1,2,3\n4,5\n" * 40),
        ("i.csv", b"hello there general\n" * 40),
        ("j.obj", b"v 1 2 3\n"),
        ("k.bin", b""),
    ],
)  # fmt: skip
def test_hostile_files_are_refused(tmp_path: Path, name: str, raw: bytes) -> None:
    (tmp_path / name).write_bytes(raw)
    with pytest.raises(SourceError) as error:
        read_cloud(tmp_path / name)
    assert "\n" not in str(error.value)


def test_a_bin_of_odd_size_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(FILES["d.bin"][:-5])
    with pytest.raises(SourceError, match="cut off"):
        read_cloud(tmp_path / "a.bin")


def test_pickles_are_never_run(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([{"x": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(SourceError):
        read_cloud(tmp_path / "a.npy")


def test_damaged_compressed_block(tmp_path: Path) -> None:
    raw = bytearray(FILES["c.pcd"])
    start = raw.index(b"binary_compressed\n") + len(b"binary_compressed\n") + 8
    raw[start] = 0xE0
    (tmp_path / "a.pcd").write_bytes(bytes(raw))
    with pytest.raises(SourceError):
        read_cloud(tmp_path / "a.pcd")
