"""The results of a fleet's fits as a Parquet data set, which DuckDB, Polars and pandas read.

One file a run; columns are those of `FitRow`, units in their names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path

from truearm.errors import MissingTool
from truearm.files.atomic_write import atomic_file
from truearm.fleet.fit_task import FitRow


def write_results(rows: Sequence[FitRow], folder: Path) -> int:
    """Add the rows that the data set lacks as one more file, whole or not at all.

    Parameters
    ----------
    rows : sequence of FitRow
    folder : Path
        Made where it does not exist.

    Returns
    -------
    int
        How many were added.
    """
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ModuleNotFoundError:
        raise MissingTool(
            "the data set of results needs the package pyarrow, which is not installed",
            hint="pip install 'truearm[fleet]'",
        ) from None
    text, number = pa.string(), pa.float64()
    constant = pa.struct([("name", text), ("unit", text), ("nominal", number), ("value", number), ("u", number)])
    group = pa.struct([("name", text), ("scale", number), ("n_determined", number)])
    kinds = {
        **dict.fromkeys(("n_readings", "n_changed"), pa.int64()),
        **dict.fromkeys(("held_out_mm", "nominal_mm", "residual_std_mm", "moved_mm", "seconds"), number),
        "constants": pa.list_(constant),
        "variances": pa.list_(group),
    }
    schema = pa.schema([(one.name, kinds.get(one.name, text)) for one in fields(FitRow)])
    folder.mkdir(parents=True, exist_ok=True)
    there = {
        key for file in folder.glob("*.parquet") for key in pq.read_table(file, columns=["key"])["key"].to_pylist()
    }
    new = [row for row in rows if row.key not in there]
    if not new:
        return 0
    first = min(row.fitted_at for row in new).replace(":", "").partition("+")[0]
    with atomic_file(folder / f"{first}-{new[0].key[:12]}.parquet") as beside:
        pq.write_table(pa.Table.from_pylist([asdict(row) for row in new], schema=schema), beside)
    return len(new)
