"""What is compiled once: byte code where an installer left none, and the loops of the rooms that a command needs."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest

from stereocalib_core.system import compiled
from stereocalib_core.system.warmup import compile_modules


def test_modules_without_byte_code_get_some(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a_module_of_this_test.py").write_text("ANSWER = 42\n")
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.syspath_prepend(tmp_path)
    module = importlib.import_module("a_module_of_this_test")
    cached = Path(module.__spec__.cached)  # type: ignore[union-attr, arg-type]
    assert not cached.exists()
    assert compile_modules() >= 1
    assert cached.is_file()
    assert compile_modules() == 0


def test_the_work_is_dealt_out_evenly() -> None:
    hands = compiled.shares(list(compiled.SECONDS), 2)
    loads = [sum(compiled.SECONDS[room] for room in hand) for hand in hands]
    assert sorted(room for hand in hands for room in hand) == sorted(compiled.SECONDS)
    assert abs(loads[0] - loads[1]) <= max(compiled.SECONDS.values()) / 4
    assert compiled.shares(["boards"], 8) == [["boards"]]


def test_every_room_that_compiles_is_known() -> None:
    """A room with a compiled loop that nobody warms up would be compiled in the middle of a drive."""
    rooms = [tuple(room.split(".")) for room in compiled.SECONDS]
    lost = [
        str(path.relative_to(compiled.PACKAGE))
        for path in compiled.PACKAGE.rglob("*.py")
        if "@njit" in path.read_text(encoding="utf-8")
        and not any(path.relative_to(compiled.PACKAGE).parts[: len(room)] == room for room in rooms)
        and path.parent.name != "numeric"
    ]
    assert lost == []


def test_a_room_is_compiled_once_and_said_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STEREOCALIB_CACHE", str(tmp_path))
    said: list[str] = []
    for _ in range(2):
        compiled.compile_once(["boards"], said.append)
    assert len(said) == 1
    assert said[0].startswith("compiling once for this machine")
    assert compiled.known_rooms(next(tmp_path.glob("compiled-rooms-*"))) == {"boards"}
    compiled.compile_once(["boards", "sources"], said.append)
    assert len(said) == 2
    monkeypatch.setattr(compiled, "fingerprint", lambda: "of another version")
    compiled.compile_once(["boards"], said.append)
    assert len(said) == 3


def test_machine_code_that_is_gone_is_compiled_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package that was installed anew in the same place: the cache remembers rooms that are no more."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    assert compiled.missing(list(compiled.SECONDS)) == []
    for room in ("sources/formats", "simulator"):
        (tmp_path / room / "__pycache__").mkdir(parents=True)
    assert not compiled.in_place("sources", tmp_path)
    (tmp_path / "sources" / "formats" / "__pycache__" / "png.unfilter-1.py311.nbi").touch()
    assert compiled.in_place("sources", tmp_path)
    (tmp_path / "simulator" / "__pycache__" / "planet.ray-1.py311.nbi").touch()
    assert not compiled.in_place("simulator.plane", tmp_path)
    (tmp_path / "simulator" / "__pycache__" / "plane.ray-1.py311.nbi").touch()
    assert compiled.in_place("simulator.plane", tmp_path)


def test_what_comes_later_does_not_hold_up_what_comes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STEREOCALIB_CACHE", str(tmp_path))
    said: list[str] = []
    compiled.compile_once(["boards"], said.append, later=["sources"])
    first = compiled.known_rooms(next(tmp_path.glob("compiled-rooms-*")))
    assert first == {"boards"}
    assert len(said) == 1
    compiled.await_compiled()
    assert compiled.known_rooms(next(tmp_path.glob("compiled-rooms-*"))) == {"boards", "sources"}
    compiled.compile_once(["boards"], said.append, later=["sources"])
    assert compiled._behind == []
    assert len(said) == 1
