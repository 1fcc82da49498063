"""Byte code where an installer left none."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest

from stereocalib_core.benches.warmup import compile_modules


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
