"""Commands of ``truearm``, run in this process."""

from __future__ import annotations

import contextlib
import io

from truearm import command_line as main


def command_output(*arguments: object) -> tuple[int, str]:
    """The exit code of ``truearm`` with these arguments, and all that it prints, in one line."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            main.run([str(one) for one in arguments])
        except SystemExit as ended:
            return int(ended.code or 0), " ".join(said.getvalue().split())
