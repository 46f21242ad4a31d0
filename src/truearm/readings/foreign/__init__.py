"""Tables of other programs as readings: what their columns mean, and two of them joined."""

from truearm.readings.foreign.joint_scale import JointScale
from truearm.readings.foreign.table_columns import TableColumns
from truearm.readings.foreign.tables import ImportedTable, import_points, import_table

__all__ = ["ImportedTable", "JointScale", "TableColumns", "import_points", "import_table"]
