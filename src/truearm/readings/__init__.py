"""Readings: sessions and their files, lengths, import of other tables, checks before a fit, errors, fair splits."""

from truearm.readings.checks import (
    LimitExcess,
    check_angles,
    check_fit,
    check_reach,
    check_scale,
    check_sessions,
    has_reference,
    limit_excesses,
    skip_beyond_limits,
)
from truearm.readings.files import check_session_path, write_session
from truearm.readings.foreign.joint_scale import JointScale
from truearm.readings.foreign.table_columns import TableColumns
from truearm.readings.foreign.tables import ImportedTable, import_points, import_table
from truearm.readings.lengths import Lengths, read_lengths, write_lengths
from truearm.readings.point_errors import ErrorComparison, PointErrors, compare_errors, point_errors
from truearm.readings.seats import SeatErrors, length_errors, seat_errors
from truearm.readings.session import Session, read_session
from truearm.readings.split import hold_out, stratified_rows

__all__ = [
    "ErrorComparison",
    "ImportedTable",
    "JointScale",
    "Lengths",
    "LimitExcess",
    "PointErrors",
    "SeatErrors",
    "Session",
    "TableColumns",
    "check_angles",
    "check_fit",
    "check_reach",
    "check_scale",
    "check_session_path",
    "check_sessions",
    "compare_errors",
    "has_reference",
    "hold_out",
    "import_points",
    "import_table",
    "length_errors",
    "limit_excesses",
    "point_errors",
    "read_lengths",
    "read_session",
    "seat_errors",
    "skip_beyond_limits",
    "stratified_rows",
    "write_lengths",
    "write_session",
]
