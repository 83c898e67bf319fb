"""The wheel built from this checkout, installed into an empty environment and run far away from it; and the locks."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
SCENARIO = "renk2005-table2"
TRUE_SENSITIVITY_V_S2_M = (0.1, 0.15, 0.095)  # Renk et al. 2005, Table 2
TRUE_OFFSET_V = (2.45, 2.55, 2.3)


def run(*command: str | Path, cwd: Path, **environment: str) -> str:
    """The command's standard output; its standard error is in the failure's message."""
    inherited = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env=inherited | environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, f"{command}: exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@dataclass(frozen=True)
class Installed:
    """The wheel, and the environment that holds it and nothing else of ours."""

    wheel: Path
    environment: Path

    @property
    def scripts(self) -> Path:
        return self.environment / "bin"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    folder = tmp_path_factory.mktemp("wheel")
    run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, cwd=ROOT)
    (wheel,) = folder.glob("torusrig-*.whl")
    environment = folder / "environment"
    venv.create(environment, with_pip=False)
    # Installing a gigabyte of dependencies again would only test the package index, so they are borrowed, as one folder
    # on the search path. What makes the checkout importable here, an editable install's .pth or PYTHONPATH, is not
    # borrowed: .pth files count in an environment's own folder only. (.ci/run does install the dependencies.)
    scheme = {"base": str(environment), "platbase": str(environment)}
    own = Path(sysconfig.get_path("purelib", "venv", scheme))
    borrowed = {sysconfig.get_path(kind) for kind in ("purelib", "platlib")}
    (own / "borrowed.pth").write_text("\n".join(sorted(borrowed)) + "\n", encoding="utf-8")
    pip = (sys.executable, "-m", "pip", "--python", environment / "bin" / "python", "--disable-pip-version-check")
    run(*pip, "install", "--quiet", "--no-index", "--no-deps", "--ignore-installed", wheel, cwd=folder)
    return Installed(wheel, environment)


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """A folder that holds broken things under the names of ours."""
    for name in ("models", "rig", "estimators", "scenarios", "validation"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise SystemExit('a decoy was imported')\n", encoding="utf-8")
    for model in ("a465.xml", "scene.xml", "a465.urdf"):
        for folder in (tmp_path / "models" / "a465", tmp_path / "rig" / "_models" / "a465"):
            folder.mkdir(parents=True, exist_ok=True)
            (folder / model).write_text("a decoy, not XML", encoding="utf-8")
    for folder in (tmp_path / "scenarios", tmp_path):
        (folder / f"{SCENARIO}.toml").write_text("a decoy, not TOML", encoding="utf-8")
    return tmp_path


def test_the_wheel_holds_the_packages_and_the_models_and_nothing_else(installed: Installed) -> None:
    with zipfile.ZipFile(installed.wheel) as archive:
        names = set(archive.namelist())
    models = {path.relative_to(ROOT / "models") for path in (ROOT / "models").rglob("*") if path.is_file()}
    sources = {
        path.relative_to(ROOT).as_posix()
        for package in ("rig", "estimators", "scenarios")
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert {f"rig/_models/{path.as_posix()}" for path in models} <= names
    assert sources <= names
    assert {f"{package}/py.typed" for package in ("rig", "estimators", "scenarios")} <= names
    assert f"scenarios/{SCENARIO}.toml" in names
    assert {name.split("/")[0] for name in names if ".dist-info/" not in name} == {"rig", "estimators", "scenarios"}
    assert any(name.endswith(".dist-info/licenses/LICENSE") for name in names)


def test_everything_of_ours_comes_from_the_wheel(installed: Installed, foreign: Path) -> None:
    program = """if True:
        import estimators, importlib.metadata, json, rig, rig.assets, scenarios
        places = [estimators.__file__, rig.__file__, scenarios.__file__, str(rig.assets.models_root())]
        print(json.dumps([importlib.metadata.version("torusrig"), *places]))
    """
    # -I: with -c, Python itself would otherwise look into the current folder first.
    version, *places = json.loads(run(installed.scripts / "python", "-I", "-c", program, cwd=foreign))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert version == project["version"]
    assert all(Path(place).is_relative_to(installed.environment) for place in places), places


def test_a_scenario_runs_far_from_the_checkout(installed: Installed, foreign: Path, tmp_path: Path) -> None:
    before = {path: path.read_bytes() for path in foreign.rglob("*") if path.is_file()}
    rig = installed.scripts / "rig"
    run(rig, "sweep", SCENARIO, "-o", "run.parquet", cwd=foreign)
    run(rig, "calibrate", "run.parquet", "-o", "calibration.json", cwd=foreign)
    result = json.loads((foreign / "calibration.json").read_text(encoding="utf-8"))
    accelerometer = result["sensors"]["accelerometer"]

    # The answer is right: within five of its own standard deviations of what the paper put in. The command's seed is
    # fixed, so this cannot fail by chance from one run to the next; a new seed would with probability 6 x 6e-7.
    variance = {
        name: accelerometer["covariance"][index][index] for index, name in enumerate(accelerometer["parameters"])
    }
    truths = zip(accelerometer["axes"], TRUE_SENSITIVITY_V_S2_M, TRUE_OFFSET_V, strict=True)
    for channel, (axis, sensitivity, offset) in enumerate(truths, start=1):
        assert abs(axis["sensitivity"] - sensitivity) < 5 * np.sqrt(variance[f"sensitivity{channel}"])
        assert abs(axis["offset"] - offset) < 5 * np.sqrt(variance[f"offset{channel}"])

    # The answer is the checkout's, to the last digit.
    home = tmp_path / "home"
    home.mkdir()
    checkout = (sys.executable, "-c", "import scenarios.cli; scenarios.cli.main()")
    run(*checkout, "sweep", SCENARIO, "-o", "run.parquet", cwd=home, PYTHONPATH=str(ROOT))
    run(*checkout, "calibrate", "run.parquet", "-o", "calibration.json", cwd=home, PYTHONPATH=str(ROOT))
    tables = [pyarrow.parquet.read_table(folder / "run.parquet") for folder in (foreign, home)]
    assert tables[0].equals(tables[1])
    assert result["sensors"] == json.loads((home / "calibration.json").read_text(encoding="utf-8"))["sensors"]

    # The decoys were left alone.
    assert {path: path.read_bytes() for path in before} == before


@pytest.mark.parametrize("command", [("blind",), ("study", "paper"), ("study", "gap")])
def test_what_checks_the_product_stays_in_the_checkout(
    installed: Installed, foreign: Path, command: tuple[str, ...]
) -> None:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    call = [str(installed.scripts / "rig"), *command, "--help"]
    done = subprocess.run(call, cwd=foreign, env=environment, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "run it from a checkout" in done.stderr
    assert "Usage" in run(sys.executable, "-m", "validation", command[-1], "--help", cwd=ROOT)


def locked(lock: str) -> dict[str, str]:
    """Version by canonical name, every entry pinned and hashed."""
    entries = re.split(r"\n(?=[A-Za-z0-9])", (ROOT / lock).read_text(encoding="utf-8"))[1:]
    versions = {}
    for entry in entries:
        pin = re.match(r"([A-Za-z0-9._-]+)==(\S+)", entry)
        assert pin, f"{lock}: not pinned: {entry.splitlines()[0]}"
        assert re.search(r"--hash=sha256:[0-9a-f]{64}", entry), f"{lock}: no hash: {pin.group()}"
        versions[canonicalize_name(pin[1])] = pin[2]
    return versions


@pytest.mark.parametrize("lock", ["requirements.lock", "dev.lock", "docs.lock", "bench.lock"])
def test_a_lock_names_no_address_and_no_path(lock: str) -> None:
    assert locked(lock)
    for line in (ROOT / lock).read_text(encoding="utf-8").splitlines():
        assert not re.search(r"://|index-url|find-links|^-[ief]\b| @ |/", line), line


def test_the_locks_answer_pyproject() -> None:
    pyproject = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    project, groups = pyproject["project"], pyproject["dependency-groups"]
    asked = {
        "requirements.lock": [*project["dependencies"], *groups["backend"], *pyproject["build-system"]["requires"]],
        "dev.lock": [
            *project["dependencies"],
            *(entry for extra in project["optional-dependencies"].values() for entry in extra),
            *groups["dev"],
            *groups["backend"],
        ],
        "bench.lock": groups["peers"],
        "docs.lock": groups["docs"],
    }
    for lock, entries in asked.items():
        versions = locked(lock)
        for requirement in map(Requirement, entries):
            version = versions.get(canonicalize_name(requirement.name))
            assert version is not None, f"{requirement} is not in {lock}: make lock"
            assert requirement.specifier.contains(version), f"{lock} has {version}, asked is {requirement}: make lock"
    tests = locked("dev.lock")
    assert locked("requirements.lock").items() <= tests.items(), "what runs is not what is tested: make lock"
    for lock in ("bench.lock", "docs.lock"):
        shared = tests.items() & locked(lock).items()
        both = tests.keys() & locked(lock).keys()
        assert {name for name, _ in shared} == both, f"{lock} has other versions than the tests: make lock"


def test_the_citation_has_the_version() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert (citation["version"], citation["license"]) == (project["version"], project["license"])
