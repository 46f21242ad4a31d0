"""Readings of an arm: the record, the session file, lengths, foreign tables, what a fit demands, fair splits."""

from truearm.readings.checks import check_angles, check_fit, check_reach, check_sessions, has_reference
from truearm.readings.files import check_session_path, read_session, write_session
from truearm.readings.lengths import Lengths, read_lengths, write_lengths
from truearm.readings.point_errors import ErrorComparison, PointErrors, compare_errors, point_errors
from truearm.readings.seats import SeatErrors, length_errors, seat_errors
from truearm.readings.session import Session
from truearm.readings.split import hold_out, stratified_rows
from truearm.readings.tables import JointScale, TableColumns, import_table

__all__ = [
    "ErrorComparison",
    "JointScale",
    "Lengths",
    "PointErrors",
    "SeatErrors",
    "Session",
    "TableColumns",
    "check_angles",
    "check_fit",
    "check_reach",
    "check_session_path",
    "check_sessions",
    "compare_errors",
    "has_reference",
    "hold_out",
    "import_table",
    "length_errors",
    "point_errors",
    "read_lengths",
    "read_session",
    "seat_errors",
    "stratified_rows",
    "write_lengths",
    "write_session",
]
