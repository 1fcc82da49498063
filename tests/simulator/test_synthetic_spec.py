"""How a synthetic drive is asked for, and what is refused."""

from __future__ import annotations

import pytest

from stereocalib_core.errors import ConfigError
from stereocalib_core.simulator.faults import KINDS, Fault, parse_fault, spell
from stereocalib_core.simulator.settings import DriveSettings, from_options, parse_spec


def test_defaults() -> None:
    settings = parse_spec("synthetic")
    assert settings == DriveSettings() == parse_spec("synthetic:town")
    assert (settings.mount_height_m, settings.mount_pitch_deg) == (1.65, 0.8)
    assert (settings.mount_roll_deg, settings.mount_yaw_deg) == (-0.4, -0.3)


def test_every_key_comes_back() -> None:
    spec = "synthetic:curves?seed=7&frames=30&traffic=0.5&lidar=1&fault=knock:pitch=-0.5@40&fault=rain@5-9&fault=drop@3"
    settings = parse_spec(spec)
    assert settings.faults == (
        Fault("knock", "pitch", -0.5, 40, None),
        Fault("rain", None, 0.0, 5, 9),
        Fault("drop", None, 0.0, 3, 3),
    )
    assert parse_spec(settings.spec()) == settings
    assert from_options("curves", {"seed": "7"}, []) == parse_spec("synthetic:curves?seed=7")


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_fault_is_understood(kind: str) -> None:
    fault = parse_fault(f"{kind}@10-20")
    assert parse_fault(spell(fault)) == fault
    assert fault.active(10) and fault.active(15) and not fault.active(9)
    assert parse_fault(kind).first == 0


def test_drift_grows_and_stays() -> None:
    fault = parse_fault("drift:roll=1@10-20")
    assert [fault.amount(i, 100) for i in (0, 10, 15, 20, 50)] == [0.0, 0.0, 0.5, 1.0, 1.0]
    knock = parse_fault("knock:height=0.05@10")
    assert [knock.amount(i, 100) for i in (9, 10, 99)] == [0.0, 1.0, 1.0]


@pytest.mark.parametrize(
    "spec",
    [
        "synthetic:village",
        "synthetic?colour=1",
        "synthetic?seed",
        "synthetic?seed=a",
        "synthetic?seed=1&seed=2",
        "synthetic?frames=0",
        "synthetic?noise=-1",
        "synthetic?noise=nan",
        "synthetic?mount_height_m=-2",
        "synthetic?path=/nowhere/poses.txt",
        "synthetic?fault=explosion@3",
        "synthetic?fault=knock:size=3@3",
        "synthetic?fault=knock:pitch=@3",
        "synthetic?fault=knock:pitch=lots@3",
        "synthetic?fault=knock:pitch=500@3",
        "synthetic?fault=rectification:height=0.1@3",
        "synthetic?fault=rain:pitch=1@3",
        "synthetic?fault=rain@9-3",
        "synthetic?fault=rain@",
        "synthesis",
    ],
)
def test_nonsense_is_refused_in_one_line(spec: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_spec(spec)
    assert "\n" not in str(caught.value) and str(caught.value).count(": ") >= 2
