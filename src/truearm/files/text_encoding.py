"""The encoding of a text: by its byte order mark, else the one of a few that its bytes fit."""

from __future__ import annotations

import codecs
import re

# What spreadsheets under Windows write where they are not asked for UTF-8.
WINDOWS = "cp1252"
CHINESE = "gb18030"

_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
_SAMPLE = 4096
_NOT_ASCII = re.compile(rb"[\x80-\xff]+")


def recognise_encoding(data: bytes) -> str:
    """Return the encoding of a text: UTF-8, UTF-16, GB18030 or cp1252.

    Notes
    -----
    In Chinese text of GB18030 the usual characters are pairs of bytes from A1 on (GB 2312; the first up to D7), so runs
    of such bytes are even. In cp1252 an accented letter or a degree sign mostly stands alone, and small letters with
    accents begin at E0.
    """
    for mark, encoding in _MARKS.items():
        if data.startswith(mark):
            return encoding
    for first, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):
        zeros = data[first:_SAMPLE:2]
        if zeros and zeros.count(0) > 0.9 * len(zeros):
            return encoding
    try:
        data.decode()
    except UnicodeDecodeError:
        runs = _NOT_ASCII.findall(data)
        leads = [byte for run in runs for byte in run[::2]]
        in_pairs = all(len(run) % 2 == 0 and min(run) >= 0xA1 for run in runs)
        return CHINESE if in_pairs and sum(byte <= 0xD7 for byte in leads) > 0.8 * len(leads) else WINDOWS
    return "utf-8"
