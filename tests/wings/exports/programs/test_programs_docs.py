"""The page about programs: its module, its commands, and its frames."""

from page_transcripts import block, check_printed, commands
from truearm.files.toml_documents import parse_toml
from truearm.wings.exports.programs.frames_file import FramesFile


def test_its_commands_print_what_it_says(truearm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pick.mod").write_text(block("programs.md", "text pick.mod"))
    for (_, *arguments), shown in commands(block("programs.md", "console programs")):
        ran = truearm(*arguments)
        assert ran.code == 0, ran.err
        if shown:
            check_printed(shown, ran.out.splitlines())
    assert (tmp_path / "corrected.mod").read_text().startswith("MODULE Pick\n! truearm command ")


def test_its_frames_are_a_file_of_frames():
    frames = parse_toml(block("programs.md", "toml frames.toml").encode(), FramesFile)
    assert frames.tool_of("TGRIP")[:3, 3].tolist() == [0.0, 0.0, 120.5]
    assert frames.work_of("2")[:3, 3].tolist() == [600.0, -100.0, 300.0]
