"""Tables of other programs: read from text, spreadsheets, arrays and logs as named columns."""
