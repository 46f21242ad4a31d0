"""The page about the virtual arm says what the program does."""

import re
from pathlib import Path

import pytest

from truearm.wings.planning.designs.sampling import STRATEGIES
from truearm.wings.planning.virtual import PRESETS, magnitudes

PAGE = Path(__file__).parents[4] / "docs" / "virtual-arm.md"


def test_the_table_of_magnitudes_is_that_of_the_presets():
    rows = re.findall(r"^\| `(\w+)` (\| .* \| [^|]+) \|$", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    drawn = [magnitudes(PRESETS[name]) for name in ("research", "shop", "worn", "printed")]
    stated = {
        row[0].name: f"| {' | '.join(f'{magnitude.value:.6g}' for magnitude in row)} | {row[0].unit}"
        for row in zip(*drawn, strict=True)
    }
    shown = [(name, cells) for name, cells in rows if name in stated]
    assert len(shown) > 10
    assert all(stated[name] == cells for name, cells in shown)
    assert all(magnitude.source for row in drawn for magnitude in row)


@pytest.mark.parametrize("name", [*PRESETS, *STRATEGIES])
def test_every_preset_and_strategy_is_explained(name):
    assert f"`{name}`" in PAGE.read_text(encoding="utf-8")


def test_its_example_gives_the_numbers_it_states():
    text = PAGE.read_text(encoding="utf-8")
    names: dict = {}
    exec(text.split("```python")[1].split("```")[0], names)
    arm, session = names["arm"], names["session"]
    assert arm.nominal_error(session)["mean_abs_coordinate_mm"] == pytest.approx(0.45, abs=0.02)
    # 200 poses: the mean of 600 coordinates scatters by 3 %.
    assert arm.noise_floor(session)["mean_abs_coordinate_mm"] == pytest.approx(0.0068, abs=0.0006)
