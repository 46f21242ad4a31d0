"""The page about the virtual arm says what the program does."""

from pathlib import Path

import pytest

from truearm.identification.planning.sampling import STRATEGIES
from truearm.identification.virtual import PRESETS, magnitudes

PAGE = Path(__file__).parents[3] / "docs" / "virtual-arm.md"


def test_the_table_of_magnitudes_is_that_of_the_presets():
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    drawn = [magnitudes(PRESETS[name]) for name in ("research", "shop", "worn", "printed")]
    for row in zip(*drawn, strict=True):
        values = " | ".join(f"{magnitude.value:.6g}" for magnitude in row)
        assert f"| `{row[0].name}` | {values} | {row[0].unit} |" in lines
        (source,) = (line for line in lines if line.startswith(f"- {row[0].source}: `"))
        assert f"`{row[0].name}`" in source


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
