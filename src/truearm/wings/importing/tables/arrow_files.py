"""Tables from Parquet, Feather and Arrow files, and from data frames."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from truearm.errors import InputError, extra_module
from truearm.files.delimited import MAX_BYTES
from truearm.files.file_reading import check_readable
from truearm.wings.importing.tables.named_arrays import MAX_CELLS, columns_of, table_of_columns
from truearm.wings.importing.tables.table import Table, TableForm, unreadable

if TYPE_CHECKING:
    import pandas as pd


def read_arrow_table(path: Path, _: TableForm | None = None) -> Table:
    """Read a Parquet, Feather or Arrow file; lists of one length become columns such as ``q[0]``.

    Raises
    ------
    InputError
        If it is damaged, too large when unpacked, or pyarrow is missing.
    """
    check_readable(path, limit_bytes=MAX_BYTES)
    needs, hint = "Parquet needs the package pyarrow", "pip install 'truearm[parquet]', or save it as CSV"
    parquet, feather = (extra_module(f"pyarrow.{kind}", needs, hint, file=path) for kind in ("parquet", "feather"))
    try:
        with path.open("rb") as file:
            if file.read(4) == b"PAR1":
                size = parquet.read_metadata(path)
                if (n_cells := size.num_rows * size.num_columns) > MAX_CELLS:
                    raise InputError(f"expected at most {MAX_CELLS} cells, got {n_cells}", file=path)
                frame = parquet.ParquetFile(file).read().to_pandas()
            else:
                frame = feather.read_table(file).to_pandas()
    except InputError:
        raise
    except Exception as error:  # it can be damaged in many ways
        raise unreadable(path, "a Parquet or Arrow file", error, "save it again") from None
    return table_of_frame(frame, path)


def table_of_frame(frame: pd.DataFrame, file: Path | None = None) -> Table:
    """Make a table of a data frame, of a file or not; its rows are counted from 1 in their order, whatever its index.

    Names of several levels are joined by blanks. Missing values are NaN in columns of numbers, and empty in text.

    Raises
    ------
    InputError
        If it has no rows or no columns.

    Examples
    --------
    >>> import pandas as pd
    >>> from truearm.wings.importing.tables.arrow_files import table_of_frame
    >>> table = table_of_frame(pd.DataFrame({"J1": [10, 20], "point": [[1.0, 2.0], [3.0, 4.0]]}))
    >>> table.names
    ('J1', 'point[0]', 'point[1]')
    """
    import pandas as pd

    columns = []
    for name, series in frame.items():
        parts = (str(part) for part in name if str(part)) if isinstance(name, tuple) else (str(name),)
        if pd.api.types.is_timedelta64_dtype(series):
            series = series.dt.total_seconds()
        if pd.api.types.is_any_real_numeric_dtype(series):
            values = series.to_numpy(dtype=float, na_value=np.nan)
        else:
            values = series.astype(object).where(series.notna(), None).to_numpy()
        columns += columns_of(" ".join(parts), values, file)
    return table_of_columns(columns, file=file)
