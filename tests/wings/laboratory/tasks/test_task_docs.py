"""docs/task-uncertainty.md: its transcript is what the command prints, numbers apart."""

import re

from command_line import called
from page_transcripts import block, blocks


def masked(text):
    """Numbers as #, blanks as one: columns move with them."""
    return re.sub(r" +", " ", re.sub(r"[+-]?\d+(\.\d+)?", "#", text)).splitlines()


def test_the_transcript_is_what_is_printed(tmp_path, capsys):
    (tmp_path / "mpe.toml").write_text(block("verification.md", "toml mpe"))
    shown = [text.partition("\n") for text in blocks("task-uncertainty.md", "console")]
    command, _, transcript = next(one for one in shown if "--mpe mpe.toml" in one[0])
    assert command == "$ truearm task --mpe mpe.toml --feature length --length 500 --at 600,0,300 --tolerance 0.08"
    code = called("task", mpe=tmp_path / "mpe.toml", length=500.0, at="600,0,300", tolerance=0.08, arms=100)
    printed = masked(capsys.readouterr().out)
    beginning, end = (masked(part) for part in transcript.split("...\n"))
    # What the numbers say may be another with fewer arms: the advice on points.
    advice = next(i for i, line in enumerate(beginning) if "points would give" in line or "dominate" in line)
    shown = beginning[:advice] + beginning[advice + 1 :] + end
    of_these = printed[:advice] + printed[advice + 1 : len(beginning)] + printed[-len(end) :]
    assert of_these == shown
    assert code == 3
