"""`view` as a process: says where it is, answers, and stops at once."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest


def free_port() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return str(probe.getsockname()[1])


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
def test_serves_until_interrupted(short_drive: Path, host: str) -> None:
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "stereocalib_app.cli.main",
            "view",
            str(short_drive),
            "--port",
            free_port(),
            "--host",
            host,
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    try:
        assert process.stdout is not None
        line = process.stdout.readline().strip()
        assert line.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(line, timeout=30) as answer:
            assert answer.status == 200
            assert b"<html" in answer.read().lower()
        process.send_signal(signal.SIGINT)
        begin = time.monotonic()
        out, err = process.communicate(timeout=30)
    finally:
        process.kill()
    assert process.returncode == 130, err
    assert time.monotonic() - begin < 8.0
    assert out == ""
    assert "Traceback" not in err
    assert ("warning: the page listens on 0.0.0.0" in err) == (host == "0.0.0.0")


def test_a_folder_that_is_no_drive_is_one_line(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "stereocalib_app.cli.main", "view", str(tmp_path), "--port", free_port()],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert done.stderr.startswith("stereocalib: error: ")
