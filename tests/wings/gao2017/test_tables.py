"""The paper's numbers as data: sums over its columns, taken by hand from the printed tables."""

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.arm.denavit_hartenberg import chain_from_dh
from truearm.wings.gao2017.tables import FINAL_TEST, N_FINAL_TEST, N_TEST, TABLE_1, TABLES, TIP_MM


@pytest.mark.parametrize(
    ("table", "rows", "mean", "largest", "seconds", "epochs"),
    [
        (2, 17, 171.5231, 464.1757, 1513, 10575),
        (3, 12, 229.1459, 1051.4776, 28591, 9589),
        (4, 4, 0.1146, 1.0421, 2867, 2715),
    ],
)
def test_columns_add_up_as_printed(table, rows, mean, largest, seconds, epochs):
    found = TABLES[table]
    assert [row.row for row in found] == list(range(1, rows + 1))
    # Printed digits: four decimals of a millimetre.
    assert sum(row.mean_mm for row in found) == pytest.approx(mean, abs=1e-9)
    assert sum(row.max_mm for row in found) == pytest.approx(largest, abs=1e-9)
    assert sum(row.seconds for row in found) == seconds
    assert sum(row.epochs for row in found) == epochs


def test_settings_as_printed():
    assert [row.n_train for row in TABLES[2]] == [10000, 8000, 5000, 20000, 9000, *[10000] * 12]
    assert [row.hidden for row in TABLES[2]] == [*[(10,)] * 11, (3,), (4,), (13,), (50,), (100,), (20, 20)]
    assert [row.learning_rate for row in TABLES[2]] == [*[0.1] * 7, 1, 0.01, 0.001, 10, *[0.1] * 6]
    assert [row.goal for row in TABLES[2]] == [*[4e-5] * 5, 1e-5, 4e-6, *[4e-5] * 10]
    two = [(10, 10), (30, 30), (50, 50), (40, 40), (80, 80), *[(50, 50)] * 4]
    assert [row.hidden for row in TABLES[3]] == [(100,), (200,), (300,), *two]
    assert [row.trainer for row in TABLES[3]] == [*["trainlm"] * 10, "traingd", "traingdx"]
    assert [row.hidden for row in TABLES[4]] == [(50, 50), (40, 40), (300,), (30, 30)]
    assert {row.n_train for row in TABLES[3]} == {9000}
    assert {row.n_train for row in TABLES[4]} == {3000}
    assert N_TEST == {2: 10, 3: 10, 4: 100}


def test_the_first_table_is_the_arm_that_we_ship():
    a, d, theta, alpha = np.array(TABLE_1).T
    printed = chain_from_dh(a=a, d=d, alpha=np.radians(alpha), theta=np.radians(theta), tip_in_flange=TIP_MM)
    angles = np.linspace(-1, 1, 30).reshape(5, 6)
    # Equal but for rounding [mm].
    np.testing.assert_allclose(printed.tip_in_base(angles), load_arm("gao2017").chain.tip_in_base(angles), atol=1e-9)


def test_the_final_test_is_that_of_the_experiment():
    assert (FINAL_TEST["nominal"].mean_mm, FINAL_TEST["nominal"].max_mm) == (0.4492, 0.8978)
    assert (FINAL_TEST["network"].mean_mm, FINAL_TEST["network"].max_mm) == (0.0136, 0.0873)
    # 0.4492 to 0.0136 mm is 97.0 %, printed as 97.
    assert 100 * (1 - FINAL_TEST["network"].mean_mm / FINAL_TEST["nominal"].mean_mm) == pytest.approx(97, abs=0.5)
    assert (N_FINAL_TEST, FINAL_TEST["network"].over_mm) == (200, {0.05: 13, 0.08: 3})
