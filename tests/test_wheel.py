"""The wheel holds everything: built, installed outside the checkout, and its command run there."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parents[1]


def run(*argv: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        [sys.executable, "-I", *map(str, argv)],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built with the build back end that is installed already (no download)."""
    folder = tmp_path_factory.mktemp("dist")
    run("-m", "build", "--wheel", "--no-isolation", "--outdir", folder, REPO, cwd=folder)
    (built,) = folder.glob("stereocalib-*.whl")
    return built


def test_the_wheel_runs_outside_the_checkout(wheel: Path, tmp_path: Path) -> None:
    home = tmp_path / "installed"
    run("-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target", home, wheel, cwd=tmp_path)
    code = (
        f"import sys; sys.path.insert(0, {str(home)!r}); import stereocalib_app.cli.main, stereocalib_core;"
        f"assert stereocalib_core.__file__.startswith({str(home)!r});"
        "sys.exit(stereocalib_app.cli.main.main(sys.argv[1:]))"
    )
    assert "KITTI odometry" in run("-c", code, "--help", cwd=tmp_path).stdout
    assert run("-c", code, "--version", cwd=tmp_path).stdout.startswith("stereocalib ")
    command = next((home / "bin").glob("stereocalib*"))
    assert "stereocalib_app.cli.main" in command.read_text()


def test_the_wheel_holds_every_module_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
    modules = {
        str(path.relative_to(folder.parent))
        for folder in (REPO / "stereocalib_core", REPO / "app" / "stereocalib_app")
        for path in folder.rglob("*.py")
    }
    assert modules <= names
    assert {name.split("/")[0] for name in names} == {"stereocalib_core", "stereocalib_app"}


def test_a_package_of_somebody_else_called_app_still_works(wheel: Path, tmp_path: Path) -> None:
    """Installed into one folder with it, before and after: each finds its own."""
    home = tmp_path / "installed"
    theirs = home / "app"
    theirs.mkdir(parents=True)
    (theirs / "__init__.py").write_text("OWNER = 'somebody else'\n")
    (theirs / "cli.py").write_text("def main():\n    return 'theirs'\n")
    run("-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target", home, wheel, cwd=tmp_path)
    code = (
        f"import sys; sys.path.insert(0, {str(home)!r}); import app, app.cli;"
        "assert app.OWNER == 'somebody else'; assert app.cli.main() == 'theirs';"
        "import stereocalib_app.cli.main as ours, app as again; assert again is app;"
        "sys.exit(ours.main(sys.argv[1:]))"
    )
    assert "KITTI odometry" in run("-c", code, "--help", cwd=tmp_path).stdout
    assert (theirs / "cli.py").read_text().startswith("def main")
