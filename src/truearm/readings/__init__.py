"""Readings: sessions and their files, lengths, checks before a fit, errors, fair splits."""

from truearm.readings.checks import (
    LimitExcess,
    check_angles,
    check_fit,
    check_reach,
    check_scale,
    check_sessions,
    has_reference,
    limit_excesses,
    serial_number_of,
    serial_number_of_all,
    skip_beyond_limits,
)
from truearm.readings.files import check_session_path, write_session
from truearm.readings.lengths import Lengths, read_lengths, write_lengths
from truearm.readings.point_errors import (
    ErrorComparison,
    LengthSummary,
    PointErrors,
    SeatErrors,
    compare_errors,
    has_repeated_seat,
    length_errors,
    point_errors,
    seat_errors,
)
from truearm.readings.readings import NAMED, PAYLOAD
from truearm.readings.session import Session, read_session, stratified_rows
from truearm.readings.thermal_expansion import expanded_lengths

__all__ = [
    "NAMED",
    "PAYLOAD",
    "ErrorComparison",
    "LengthSummary",
    "Lengths",
    "LimitExcess",
    "PointErrors",
    "SeatErrors",
    "Session",
    "check_angles",
    "check_fit",
    "check_reach",
    "check_scale",
    "check_session_path",
    "check_sessions",
    "compare_errors",
    "expanded_lengths",
    "has_reference",
    "has_repeated_seat",
    "length_errors",
    "limit_excesses",
    "point_errors",
    "read_lengths",
    "read_session",
    "seat_errors",
    "serial_number_of",
    "serial_number_of_all",
    "skip_beyond_limits",
    "stratified_rows",
    "write_lengths",
    "write_session",
]
