"""The page of the camera: what its command prints."""

from page_transcripts import block, blocks, check_printed
from truearm.wings.camera.virtual_cell import small_cell


def test_the_command_prints_what_its_page_shows(truearm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    session, pixels = small_cell("ur5", seed=1).table(40, seed=5)
    session.save("joints.csv")
    pixels.save("pixels.csv")
    command = next(line for line in block_of_command().splitlines() if line.startswith("truearm fit-images"))
    ran = truearm(*command.split()[1:])
    assert ran.code == 0, ran.err
    check_printed(block("camera.md", "text fit-images").splitlines(), ran.out.strip().splitlines())


def block_of_command() -> str:
    return next(text for text in blocks("camera.md", "sh") if "fit-images" in text)
