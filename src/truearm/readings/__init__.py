"""Readings of an arm: the record, the session file, foreign tables, what a fit demands, fair splits."""

from truearm.readings.checks import check_angles, check_fit, check_reach
from truearm.readings.deviations import ComparedErrors, Errors, compared_errors, errors_of
from truearm.readings.files import check_session_path, read_session, write_session
from truearm.readings.readings import Readings
from truearm.readings.split import hold_out
from truearm.readings.tables import JointScale, TableColumns, import_table

__all__ = [
    "ComparedErrors",
    "Errors",
    "JointScale",
    "Readings",
    "TableColumns",
    "check_angles",
    "check_fit",
    "check_reach",
    "check_session_path",
    "compared_errors",
    "errors_of",
    "hold_out",
    "import_table",
    "read_session",
    "write_session",
]
