"""``rig study`` and ``rig view`` of a study, as a user calls them."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import matplotlib.image
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from cli_support import SMALL, Rig
from rerun.chunk import RrdReader

import scenarios
from rig.files import file_hash
from scenarios.plots.study_consistency import consistency_figure
from scenarios.plots.study_subsets import subsets_figure
from scenarios.studies.error_summary import RATES, Summary
from scenarios.studies.settings import Settings
from scenarios.studies.subsets import study

COMMANDS = ("consistency", "subsets", "paper")
CONSISTENCY = ("study", "consistency", "small.toml", "-o", "st", "--draws", "30", "--counts", "3", "--workers", "0")
#: Every figure takes a second: one method, and two of three orders.
CHOSEN = ("--method", "separate", "--order", "every-kth", "--order", "random")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("cli")
    (path / "small.toml").write_text(
        SMALL.replace("decimation = 10", 'range_V = "none"\nbits = "none"\ndecimation = 10')
    )
    return path


@pytest.fixture
def here(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def studied(here: Path, rig: Rig) -> Path:
    """The folder with a consistency study in it, made once."""
    if not (here / "st").exists():
        rig.done(*CONSISTENCY, *CHOSEN)
    return here / "st"


@pytest.mark.parametrize("command", COMMANDS)
def test_every_study_helps_with_an_example_and_speaks_json(rig: Rig, command: str) -> None:
    text = rig.done("study", command, "--help")
    assert f"rig study {command}" in text
    assert "--json" in text
    assert command in rig.done("study", "--help")


def test_consistency_leaves_tables_and_plots(studied: Path) -> None:
    names = {path.name for path in studied.iterdir()}
    plots = {
        f"{sensor}-separate{suffix}" for sensor in ("accelerometer", "magnetometer") for suffix in (".png", ".svg")
    }
    assert names == {"study.json", "table.parquet", "summary.parquet", "rates.parquet", "tables.json"} | plots
    assert pq.read_metadata(studied / "table.parquet").num_rows == 30 * 3 * 2 * 2 * 2
    assert matplotlib.image.imread(studied / "accelerometer-separate.png").shape[1] > 1500
    document = json.loads((studied / "study.json").read_text())
    assert (document["format"], document["kind"]) == ("rig-study/1", "consistency")


def test_consistency_tells_what_it_found(studied: Path, rig: Rig) -> None:
    """The same command again finds everything there, and draws and tells it."""
    before = (studied / "table.parquet").stat().st_mtime_ns
    text = rig.done(*CONSISTENCY, *CHOSEN, "--parameter", "axis2_beta_deg")
    assert text == rig.done(*CONSISTENCY, *CHOSEN, "--parameter", "beta2")
    assert (studied / "table.parquet").stat().st_mtime_ns == before
    assert "accelerometer, separate fit, noise ×1: " in text
    assert " beta2 " in text
    assert "axis2" not in text
    assert "rig view st" in text
    document = json.loads(rig.done(*CONSISTENCY, *CHOSEN, "--json"))
    assert len(document["verdicts"]) == 4
    assert document["verdicts"][0]["verdict"] in ("undecided", "consistent", "consistent and efficient")
    assert len(document["cells"]) == 2 * 18 * 3 * 2 * 2
    assert all(Path(plot).is_file() for plot in document["plots"])


def test_a_parameter_that_one_method_has_is_shown_for_it(here: Path, rig: Rig) -> None:
    """Separate fits have a field direction each, simultaneous ones a common one."""
    few = ("--draws", "5", "--counts", "2", "--order", "random", "--noise", "1", "--workers", "0")
    text = rig.done("study", "consistency", "small.toml", "-o", "both", *few, "--parameter", "field_phi_deg")
    rows = [line.split() for line in text.splitlines() if " phi " in line]
    assert rows
    assert all("simultaneous" in row for row in rows)
    plots = {path.name for path in (here / "both").glob("*.png")}
    assert plots == {"accelerometer-simultaneous.png", "magnetometer-simultaneous.png"}


def test_another_study_does_not_overwrite_it(studied: Path, rig: Rig) -> None:
    line = rig.refused(*CONSISTENCY, "--method", "separate", "--order", "random")
    assert "found a study with orders" in line
    line = rig.refused("study", "consistency", "small.toml", "-o", "small.toml", "--workers", "0")
    assert "something that is no study" in line


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--parameter", "sensitivity4"), "unknown parameter of separate and simultaneous fits 'sensitivity4'"),
        (("--method", "separate", "--parameter", "field_phi_deg"), "unknown parameter of separate fits"),
        (("--noise", "1", "--noise", "1"), "noise factors: found 1.0, 1.0, expected each once"),
        (("--order", "first", "--order", "first"), "orders: found first, first, expected each once"),
        (("--order", "every-kht"), "(nearest: 'every-kth')"),
        (("--noise", "-1"), "expected positive numbers"),
        (("--first", "700"), "expected two or more, from fewer than the 600 that"),
        (("--cluster", "tcp://127.0.0.1:9"), "--cluster and a number of processes: found both"),
    ],
)
def test_wrong_calls_are_one_line(here: Path, rig: Rig, arguments: tuple[str, ...], message: str) -> None:
    assert message in rig.refused(*CONSISTENCY[:3], "-o", "other", "--workers", "0", *arguments)
    assert not (here / "other").exists()


def test_a_study_can_be_looked_at(studied: Path, rig: Rig) -> None:
    rig.done("view", studied, "-o", "st.rrd")
    entities = entities_of(Path("st.rrd"))
    assert "/accelerometer/separate/noise_1/sensitivity1/errors/random/mean" in entities
    assert "/magnetometer/separate/noise_10/offset1/ratio/every-kth/RMSE" in entities
    assert "/explained" in entities


def test_subsets_are_tabled_plotted_and_looked_at(here: Path, rig: Rig) -> None:
    rig.done("sweep", "small.toml", "-o", "run.parquet", "--locked")
    text = rig.done("study", "subsets", "run.parquet", "--subsets", "10", "-o", "sub")
    assert "noise of the bound of the locked arm" in text
    assert "accel3" in text
    assert "field direction: chi-square" in text
    names = {"channels.parquet", "fields.parquet", "study.json", "tables.json", "subsets.png", "subsets.svg"}
    assert {path.name for path in (here / "sub").iterdir()} == names | {"summary.parquet", "table.parquet"}
    document = json.loads(rig.done("study", "subsets", "run.parquet", "--subsets", "10", "--json"))
    assert len(document["channels"]) == 6
    assert document["study"] is None
    rig.done("view", "sub", "-o", "sub.rrd")
    assert "/fit_error/systematic" in entities_of(Path("sub.rrd"))
    assert "found 600 samples for 40 subsets" in rig.refused("study", "subsets", "run.parquet", "--subsets", "40")


def test_what_is_no_study_is_refused(here: Path, rig: Rig) -> None:
    (here / "empty").mkdir(exist_ok=True)
    assert "holds no study.json" in rig.refused("view", "empty", "-o", "x.rrd")
    assert "no such file or folder, expected a recording or a study" in rig.refused("view", "nowhere", "-o", "x.rrd")
    (here / "taken").write_text("")
    assert "the folder cannot be made" in rig.refused("study", "paper", "-o", "taken")


def entities_of(path: Path) -> set[str]:
    return {str(chunk.entity_path) for chunk in RrdReader(str(path)).stream()}


def test_no_text_of_the_plots_is_cut_off(studied: Path) -> None:
    summary = Summary.from_tables(pq.read_table(studied / "summary.parquet"), pq.read_table(studied / RATES))
    settings = Settings.of(scenarios.load(str(studied.parent / "small.toml")), 3)
    assert settings.counts[-1] == 600
    recording = scenarios.load("ann-arbor").simulate(0)
    for figure in (
        consistency_figure(summary, "magnetometer", "separate", one_draw=pq.read_table(studied / "table.parquet")),
        subsets_figure(study(recording)),
    ):
        figure.canvas.draw()
        frame = figure.bbox
        texts = [text for axis in figure.axes for text in (axis.title, axis._left_title, axis.xaxis.label)]  # type: ignore[attr-defined]
        boxes = [text.get_window_extent() for text in texts if text.get_text()]
        assert len(boxes) > 3
        assert all(box.x0 >= -1 and box.x1 <= frame.x1 + 1 and box.y0 >= -1 and box.y1 <= frame.y1 + 1 for box in boxes)


def test_one_draw_is_drawn_where_it_is(studied: Path) -> None:
    summary = Summary.from_tables(pq.read_table(studied / "summary.parquet"), pq.read_table(studied / RATES))
    table = pq.read_table(studied / "table.parquet")
    figure = consistency_figure(summary, "accelerometer", "separate", one_draw=table)
    lines = {line.get_label(): line for line in figure.axes[0].get_lines()}
    cells = [
        cell
        for cell in summary.cells
        if (cell.sensor, cell.method, cell.order, cell.noise_factor, cell.parameter)
        == ("accelerometer", "separate", "every-kth", 1.0, "sensitivity1")
    ]
    expected = [
        line["error_sensitivity1"] + cells[0].truth
        for line in table.to_pylist()
        if (line["sensor"], line["method"], line["order"], line["noise_factor"], line["draw"])
        == ("accelerometer", "separate", "every-kth", 1.0, 0)
    ]
    assert np.allclose(lines["one draw"].get_ydata(), expected)
    assert np.array_equal(lines["one draw"].get_xdata(), [cell.count for cell in cells])


def _twice(table: pa.Table) -> pa.Table:
    return table.append_column("order", table["order"])


def _all_alike(table: pa.Table) -> pa.Table:
    """Draws without a spread."""
    for number, name in enumerate(table.column_names):
        if name.startswith("error_"):
            table = table.set_column(number, name, pc.multiply(table[name], 0.0))
    return table


@pytest.mark.filterwarnings("ignore")  # as the command does
@pytest.mark.parametrize("forge", [_twice, _all_alike])
def test_a_forged_table_is_refused_where_the_study_goes_on(
    studied: Path, rig: Rig, tmp_path: Path, forge: Callable[[pa.Table], pa.Table]
) -> None:
    forged = tmp_path / "forged"
    shutil.copytree(studied, forged)
    pq.write_table(forge(pq.read_table(forged / "table.parquet")), forged / "table.parquet")
    hashes = {**json.loads((forged / "tables.json").read_text()), "table.parquet": file_hash(forged / "table.parquet")}
    (forged / "tables.json").write_text(json.dumps(hashes))
    command = [str(forged) if word == "st" else word for word in (*CONSISTENCY, *CHOSEN)]
    assert "its tables do not make one study" in rig.refused(*command)
