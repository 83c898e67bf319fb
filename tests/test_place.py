"""Gravity and the magnetic field by place and date, and ``rig calibrate --at``."""

from __future__ import annotations

import datetime
import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from cli_support import Rig
from diagnosed_recordings import recorded

import scenarios
from rig.errors import RigError
from rig.place import IGRF_DAYS, Place
from rig.recording import read_recording

AT = "42.28,-83.74,0"


def somigliana(latitude_deg: float) -> float:
    """Normal gravity on the ellipsoid [m/s^2]: WGS 84 by NGA.STND.0036 (2014), equation (4-1), table 3.5."""
    square = math.sin(math.radians(latitude_deg)) ** 2
    return 9.7803253359 * (1.0 + 0.00193185265241 * square) / math.sqrt(1.0 - 0.00669437999014 * square)


@pytest.mark.parametrize("latitude", [-90.0, -33.9, 0.0, 42.28, 90.0])
def test_gravity_on_the_ellipsoid_and_above_it(latitude: float) -> None:
    pytest.importorskip("boule", reason="the extra torusrig[place] is not installed")
    assert Place(latitude, 0.0).gravity() == pytest.approx(somigliana(latitude), rel=1e-9)
    # NGA.STND.0036, equation (4-3): to second order in the height, the third is 4 (h/a)^3, 1e-10 at 2 km
    height, a, f, m = 2000.0, 6378137.0, 1.0 / 298.257223563, 0.00344978650684
    square = math.sin(math.radians(latitude)) ** 2
    factor = 1.0 - 2.0 / a * (1.0 + f + m - 2.0 * f * square) * height + 3.0 * (height / a) ** 2
    # It leaves out the second order of f and m too, some ten terms of f^2 h/a = 3.5e-9; what is tested, 2 (f + m) h/a,
    # is 4e-6
    assert Place(latitude, 0.0, height).gravity() == pytest.approx(factor * somigliana(latitude), rel=4e-8)


def test_below_the_ellipsoid_it_goes_on_smoothly() -> None:
    pytest.importorskip("boule", reason="the extra torusrig[place] is not installed")
    below, on, above = (Place(42.0, 0.0, height).gravity() for height in (-30.0, 0.0, 30.0))
    # The curvature, 6 g / a^2 h^2, is 1.3e-9; rounding is far less
    assert below + above == pytest.approx(2.0 * on, abs=5e-9)


def test_the_field_is_that_of_ann_arbor() -> None:
    pytest.importorskip("ppigrf", reason="the extra torusrig[place] is not installed")
    earth = scenarios.load("ann-arbor").rig.environment.magnetic_field
    found = Place(42.28, -83.74, 256.0).magnetic_field_nT(datetime.date(2005, 1, 1))
    # That rig's base leans and is turned: the length is kept
    assert np.linalg.norm(found) * 1e-5 == pytest.approx(np.linalg.norm(earth), rel=1e-4)
    # North, east, down as published; a tenth of a degree, to which the place is known, changes them by 1e-4 G
    assert np.asarray(found) * 1e-5 == pytest.approx([0.18534, -0.02118, 0.51927], abs=2e-4)


def test_at_the_poles_the_field_is_there() -> None:
    pytest.importorskip("ppigrf", reason="the extra torusrig[place] is not installed")
    at, near = (Place(sign, 0.0).magnetic_field_nT(datetime.date(2020, 1, 1)) for sign in (90.0, 89.999))
    # 0.001 deg are 111 m, over which the field of 57,000 nT changes by at most 3/6371 of it a km: 3 nT
    np.testing.assert_allclose(at, near, atol=3.0)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ((91.0, 0.0), "latitude_deg: found 91, expected a number from -90 to 90"),
        ((0.0, 400.0), "longitude_deg: found 400"),
        ((0.0, 0.0, 1e5), "height_m: found 100000"),
        ((math.nan, 0.0), "latitude_deg: found nan"),
    ],
)
def test_what_is_not_on_the_earth_is_refused(values: tuple[float, ...], words: str) -> None:
    with pytest.raises(RigError, match=words):
        Place(*values)


@pytest.mark.parametrize("day", [datetime.date(1899, 12, 31), IGRF_DAYS[1]])
def test_days_without_the_igrf_are_refused(day: datetime.date) -> None:
    with pytest.raises(RigError, match="which the IGRF covers"):
        Place(0.0, 0.0).magnetic_field_nT(day)


def test_a_calibration_takes_the_fields_of_its_place(rig: Rig, tmp_path: Path) -> None:
    pytest.importorskip("boule", reason="the extra torusrig[place] is not installed")
    pytest.importorskip("ppigrf", reason="the extra torusrig[place] is not installed")
    path = tmp_path / "run.parquet"
    recorded()[0].write(path)
    result = rig("calibrate", path, "--at", AT, "--date", "2026-11-22", "--json")
    assert "normal gravity 9.80" in result.err
    assert "by the IGRF on 2026-11-22" in result.err
    found = json.loads(result.out)["sensors"]
    assert found["accelerometer"]["reference_magnitude"] == pytest.approx(somigliana(42.28), rel=1e-9)
    size = math.hypot(*Place(42.28, -83.74).magnetic_field_nT(datetime.date(2026, 11, 22)))
    # in gauss, the unit that the recording states
    assert found["magnetometer"]["reference_magnitude"] == pytest.approx(1e-5 * size, rel=1e-9)
    for sensor in found.values():
        assert not any("is not stated" in text for text in sensor["quality"]["warnings"])
    given = rig("calibrate", path, "--at", AT, "--gravity", "9.7", "--field", "0.5G", "--json")
    assert given.err == ""  # nothing is left to the place
    assert json.loads(given.out)["sensors"]["accelerometer"]["reference_magnitude"] == 9.7


def test_an_imported_log_takes_the_fields_of_its_place(rig: Rig, tmp_path: Path) -> None:
    pytest.importorskip("boule", reason="the extra torusrig[place] is not installed")
    rows = (f"{0.01 * k},{math.cos(k):.6f},{math.sin(k):.6f},0.0" for k in range(50))
    (tmp_path / "log.csv").write_text("\n".join(["t,ax,ay,az", *rows]) + "\n")
    rig.done("import", tmp_path / "log.csv", "--at", AT, "-o", tmp_path / "run.parquet")
    stated = read_recording(tmp_path / "run.parquet").metadata
    assert stated.gravity_m_s2 == pytest.approx(somigliana(42.28), rel=1e-9)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--at", "42.28"], "expected LAT,LON,HEIGHT"),
        (["--at", "north,1,2"], "expected LAT,LON,HEIGHT"),
        (["--at", "95,1,2", "--date", "2026-11-22"], "latitude_deg: found 95"),
        (["--at", AT, "--gravity", "9.8"], "found without --date"),
        (["--at", AT, "--gravity", "9.8", "--date", "22.11.2026"], "expected a day as in 2026-11-22"),
        (["--at", AT, "--gravity", "9.8", "--date", "2044-11-22"], "which the IGRF covers"),
        (["--date", "2026-11-22"], "found without --at"),
    ],
)
def test_wrong_places_are_refused(rig: Rig, tmp_path: Path, options: list[str], words: str) -> None:
    path = tmp_path / "run.parquet"
    recorded()[0].write(path)
    assert words in rig.refused("calibrate", path, *options)


def test_without_the_extra_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "boule", None)
    with pytest.raises(RigError, match=r"boule is not installed.*pip install 'torusrig\[place\]'"):
        Place(0.0, 0.0).gravity()
