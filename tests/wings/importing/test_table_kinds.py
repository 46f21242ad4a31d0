"""Laws of tables as programs write them: every kind is read right, or asks one question whose answer makes it right."""

import numpy as np
import pytest

from refusals import refuses
from truearm.wings.importing.foreign.no_readings import lost_targets
from truearm.wings.importing.tables import read_table
from truearm.wings.importing.tables.table import TableForm

KINDS = pytest.importorskip("benchmarks.table_kinds", reason="benchmarks are not beside the tests").all_kinds()

IN = {"deg": 1.0, "rad": 180 / np.pi, "mm": 1.0, "m": 1000.0}


def readings(kind, path, options):
    """Angles [deg] and points [mm], by the columns that a person states."""
    table = read_table(path, TableForm(**options))
    angles = np.column_stack([table.numbers(table.index(name)) for name in kind.angles])
    if not kind.points:
        return angles * IN[kind.angle_unit], None
    points = np.column_stack([table.numbers(table.index(name)) for name in kind.points])
    points[lost_targets(points)] = np.nan
    return angles * IN[kind.angle_unit], points * IN[kind.point_unit]


@pytest.mark.parametrize("name", KINDS)
def test_a_table_is_read_right_or_asks_what_makes_it_right(tmp_path, name):
    kind = KINDS[name]
    path = tmp_path / f"table{kind.suffix}"
    path.write_bytes(kind.write())
    if kind.remedy:
        caught = refuses(None, readings, kind, path, kind.options)
        assert caught.line is not None
        assert all(f"--{option}" in caught.hint for option in kind.remedy)
    assert kind.is_right(readings(kind, path, kind.options | kind.remedy))
