"""The pictures of what the effects do to a sweep."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rig.effects import EFFECTS, Kind
from rig.errors import RigError
from scenarios.plots import save
from scenarios.plots.effects import effect_change, effect_figure


@pytest.mark.parametrize("name", [name for name, effect in EFFECTS.items() if not effect.of_log])
def test_every_effect_changes_the_sweep(name: str) -> None:
    found = effect_change(EFFECTS[name])
    assert found.columns
    assert (found.left is not None) == (EFFECTS[name].kind is Kind.MEAN)
    if found.left is not None:  # what a calibration leaves is no more than what there was, by its own measure
        before, after = (float(np.sum((values / found.floor) ** 2)) for values in (found.change, found.left))
        assert 0.0 < after <= before * (1.0 + 1e-9)


def test_the_change_is_the_effects_own() -> None:
    found = effect_change(EFFECTS["bias_step"], "mag3")
    assert found.columns == [5]
    np.testing.assert_allclose(found.change[:, 5], 5.0 * (found.t >= 600.0), atol=1e-9)
    assert effect_change(EFFECTS["joint_offset"], "joint6").left is not None
    with pytest.raises(RigError, match="joint9"):
        effect_change(EFFECTS["backlash"], "joint9")


@pytest.mark.parametrize("name", ["backlash", "outliers", "vibration"])
def test_effects_are_drawn(name: str, tmp_path: Path) -> None:
    found = effect_change(EFFECTS[name])
    figure = effect_figure(found)
    assert len(figure.axes) == 2 * len(found.columns)
    assert found.effect.where in figure.get_suptitle()
    save(figure, tmp_path / "effect.png")
    assert (tmp_path / "effect.png").stat().st_size > 10_000
