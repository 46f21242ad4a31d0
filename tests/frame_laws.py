"""Law of a result that is a table: its DataFrame has a row for each line of it, and states the unit of each number."""

import pandas as pd

from truearm.verbs.record import TableRecord

UNITS = ("mm", "rad", "deg", "degC", "s", "seconds", "percent")
# Ratios, numbers of standard uncertainties, logarithms.
DIMENSIONLESS = {
    "ratio", "of_type", "drift_u", "from_type_u", "log_odds", "evidence", "evidence_of_a_change", "coverage_factor",
    "degrees_of_freedom", "conformance_probability", "conform", "not_conform", "undecided", "condition", "residual_rad",
    "goal", "epochs",
}  # fmt: skip
# Of a unit that the row states.
IN_UNIT = {
    "value", "u", "uncertainty", "expanded_uncertainty", "limit", "nominal", "old", "new", "change", "u_old", "u_new",
    "mean", "mean_u", "std", "median", "quantile_95",
}  # fmt: skip


def check_frame(record: TableRecord, n_rows: int) -> pd.DataFrame:
    """Check the law, and return the frame."""
    frame = record.to_frame()
    assert len(frame) == n_rows
    assert frame.columns.is_unique
    assert list(frame.columns) == list(record.columns())
    for name in frame.columns[[kind.kind == "f" for kind in frame.dtypes]]:
        if frame[name].dropna().mod(1).eq(0).all() and name.startswith(("n_", "check", "changed_since")):
            continue  # a count, with gaps
        if name in IN_UNIT:
            assert frame["unit"].isin(["mm", "rad", "deg", ""]).all(), name
        else:
            assert name.rpartition("_")[2] in UNITS or name in DIMENSIONLESS, name
    for name in frame.columns:
        assert not frame[name].map(lambda cell: isinstance(cell, list | dict)).any(), name
    return frame
