"""`make campaign`: thousands of damaged files, hostile messages, kills and floods, with fixed seeds; about a quarter of
an hour. Prints the table of each part and, at the end, one line a part; exit code 1 where anything went wrong.
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
KILLS = HERE.parent / "run" / "kill_and_resume.py"
PARTS = {
    "damaged recordings and calibrations": [HERE / "fuzz_sources.py", "5000"],
    "messages, reconnects, flood, soak": [HERE / "wire.py"],
    "kill and resume, rendered": [KILLS, "synthetic:town?frames=40", "--kills", "8"],
    "kill and resume, on a ramp": [
        KILLS, "synthetic:straight?frames=40&fault=ramp@5-30", "--kills", "4", "--seed", "7", "--", "--method", "paper",
    ],
}  # fmt: skip


def main() -> int:
    """Run every part after the other."""
    wrong: list[str] = []
    summary = []
    for name, command in PARTS.items():
        print(f"\n== {name}", flush=True)
        began = time.monotonic()
        code = subprocess.run([sys.executable, *map(str, command)], check=False).returncode
        summary.append(f"{'right' if code == 0 else 'WRONG':<7}{time.monotonic() - began:6.0f} s  {name}")
        wrong += [name] * (code != 0)
    print("\n" + "\n".join(summary))
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
