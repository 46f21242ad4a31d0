"""The page about planning says what the program does."""

from pathlib import Path

import numpy as np

from truearm.wings.planning.designs import candidates, exchange

PAGE = Path(__file__).parents[4] / "docs" / "planning.md"


def test_its_example_runs_and_more_places_of_the_bar_leave_less():
    names: dict = {}
    exec(PAGE.read_text(encoding="utf-8").split("```python")[1].split("```")[0], names)
    course = names["problem"].course(names["plan"])
    assert len(course) == 5
    assert (np.diff(course) < 0).all()
    assert len(names["candidates"].readings(names["plan"])) == 4 * 10


def test_what_it_names_is_there():
    text = PAGE.read_text(encoding="utf-8")
    for name in ("seat_poses", "bar_places", "tracker_poses"):
        assert f"`{name}`" in text
        assert callable(getattr(candidates, name))
    for strategy in exchange.STRATEGIES:
        assert f"*{strategy}*" in text or f"*{strategy.capitalize()}*" in text
