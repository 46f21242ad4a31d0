"""Tables of other programs as readings: what their columns mean, and two of them joined."""

from truearm.wings.importing.foreign.table_columns import JointScale, TableColumns
from truearm.wings.importing.foreign.tables import ImportedTable, import_points, import_table

__all__ = ["ImportedTable", "JointScale", "TableColumns", "import_points", "import_table"]
