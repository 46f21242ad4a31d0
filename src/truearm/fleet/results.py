"""The results of a fleet's fits as a Parquet data set, which DuckDB, Polars and pandas read.

Columns are those of `FitRow`, units in their names.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path

from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.files.extra_packages import extra_module
from truearm.fleet.fit_task import FitRow
from truearm.workflows.page_record import make_folder


def write_results(rows: Iterable[FitRow], folder: Path) -> None:
    """Write the rows as the file of the data set, whole or not at all; results of removed arms that it has stay.

    Parameters
    ----------
    rows : iterable of FitRow
    folder : Path
        Made where it does not exist.

    Raises
    ------
    TruearmError
        If pyarrow is not installed, or the file cannot be written.
    """
    needs, hint = "the data set of results needs the package pyarrow", "pip install 'truearm[fleet]'"
    pa, pc, pq = (extra_module(f"pyarrow{part}", needs, hint) for part in ("", ".compute", ".parquet"))
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
    make_folder(folder)
    found = pa.Table.from_pylist([vars(row) for row in rows], schema=schema)
    file = folder / "fits.parquet"
    try:
        if file.is_file():
            before = pq.read_table(file, partitioning=None)
            removed = before.filter(pc.invert(pc.is_in(before["key"], found["key"])))
            found = pa.concat_tables([found, removed], promote_options="default").select(schema.names)
    except (pa.ArrowException, KeyError) as error:
        raise InputError(f"the data set of results is damaged ({error})", file=file, hint="move it away") from None
    with atomic_file(file) as beside:
        pq.write_table(found, beside)
