"""Names made to fill the memory, or to be cut short, are refused before they do harm."""

import numpy as np
import pandas as pd
import pytest

from refusals import refuses
from truearm.readings import read_session


def test_a_name_longer_than_any_label_is_refused_with_its_line(tmp_path):
    path = tmp_path / "s.csv"
    path.write_text("q1_deg,seat\n1,A\n2," + "x" * 100_000 + "\n3,B\n")
    caught = refuses("at most 200 characters, got one of 100000", read_session, path)
    assert (caught.line, caught.column) == (3, "seat")


@pytest.mark.parametrize(
    ("name", "says"), [("x" * 5000, "at most 200 characters"), ("A\0", "control"), ("A\nB", "control")]
)
def test_parquet_names_follow_the_same_rules(tmp_path, name, says):
    pytest.importorskip("pyarrow")
    path = tmp_path / "s.parquet"
    pd.DataFrame({"q1_deg": [1.0, 2.0], "seat": ["A", name]}).to_parquet(path, index=False)
    refuses(says, read_session, path)


def test_categories_of_pandas_are_names(tmp_path):
    pytest.importorskip("pyarrow")
    path = tmp_path / "s.parquet"
    table = pd.DataFrame({"q1_deg": np.arange(4.0), "seat": pd.Categorical(["A", "B", "A", "B"])})
    table.to_parquet(path, index=False)
    assert read_session(path).seat.tolist() == ["A", "B", "A", "B"]
