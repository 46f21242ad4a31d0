"""What a command does with a file that exists: the table of docs/files.md, row by row."""

import shutil
import zipfile
from pathlib import Path

import pytest

import truearm as ta
from command_line import declared

pytestmark = pytest.mark.usefixtures("undrawn", "quick_plans")

DOCS = Path(__file__).parents[2] / "docs" / "files.md"
KEPT, OWN, FREE = "kept", "replaced by its own kind", "same arm's replaced"
# Options and arguments that name a file or folder that is read.
READ = {"artefacts", "certificate", "files", "folder", "model", "new", "old", "session", "table", "targets"}
READ |= {"--about", "--artefacts", "--as-found", "--check", "--from-circles", "--key", "--lengths", "--list", "--logo"}
READ |= {"--measured", "--model-file", "--mpe", "--plan", "--prior", "--read", "--region", "--session", "--signer"}
READ |= {"--camera", "images", "pixels", "robot", "samples"}
READ |= {"--frames", "--test-images", "--test-session", "--trusted", "--with"}


def rows() -> dict[tuple[str, str], str]:
    """Command and option, and what becomes of a file that exists."""
    lines = [line for line in DOCS.read_text(encoding="utf-8").splitlines() if line.startswith("|")]
    cells = [[cell.strip(" `") for cell in line.strip("|").split("|")] for line in lines]
    return {(command, option): after for command, option, _, after in cells[2:]}


def of_kind(*kinds: str) -> list[tuple[str, str]]:
    return [row for row, after in rows().items() if after.replace("`", "") in {kind.replace("`", "") for kind in kinds}]


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> Path:
    """A session, a model of its arm, and one of another arm."""
    folder = tmp_path_factory.mktemp("files")
    for name, arm_seed in (("m", 1), ("other", 2)):
        session = ta.simulate("ur10", poses=30, seed=1, arm_seed=arm_seed).session
        session.save(folder / f"{name}.csv")
        ta.fit("ur10", session, model="nominal").save(folder / f"{name}.truearm")
    return folder


@pytest.fixture
def bench(files, tmp_path, monkeypatch) -> Path:
    """The same in a folder of its own, the current one."""
    shutil.copytree(files, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


CERTIFICATE = "certificate --test-plan iso10360-12 --measured p.csv --artefacts a.toml --mpe l.toml --about b.toml"
IMAGES = "fit-images m.csv p.csv --arm ur10 --board charuco:8x11,15mm,11mm"
# ARM and OUT stand for the file that the row is about.
WRITES: dict[tuple[str, str], str] = {
    ("arms", "--out"): "arms gao2017 --out x.toml",
    ("arms", "--apply"): "arms ur10 --session m.csv --apply x.toml",
    ("fetch", "--out"): "fetch ur10-a --out x.csv",
    ("simulate", "--out"): "simulate gao2017 --poses 5 --out x.csv",
    ("simulate", "--out-lengths"): "simulate ur10 --strategy seat --bars 2 --out-lengths x.csv --out y.csv",
    ("plan", "--out"): "plan gao2017 --artefact tracker --out x.csv",
    ("plan-images", "--out"): "plan-images ur5 --poses 6 --out x.csv",
    ("hand-eye", "--out"): "hand-eye p.csv m.csv --as yaml --out x.yaml",
    ("hand-eye", "--out-model"): "hand-eye p.csv m.csv --arm ur10 --out-model x.truearm",
    ("fit-images", "--apply"): f"{IMAGES} --out y.truearm --apply x.toml",
    ("fit-images", "--out"): f"{IMAGES} --out x.truearm",
    ("fit-images", "--camera-out"): f"{IMAGES} --out y.truearm --camera-out x.yaml",
    ("sources", "--out"): "sources --try microscribe:COM1 --out x.toml",
    ("record", "--out-model"): "record --source replay:m.csv --out y.csv --arm ur10 --out-model x.truearm",
    ("live", "--out-model"): "live --source replay:m.csv --out y.csv --arm ur10 --out-model x.truearm",
    ("import", "--out"): "import m.csv --out x.csv",
    ("split", "--train"): "split m.csv --by row --train x.csv --test y.csv",
    ("split", "--test"): "split m.csv --by row --train y.csv --test x.csv",
    ("fit", "--apply"): "fit m.csv --arm ur10 --out y.truearm --apply x.toml",
    ("verify sheet", "--out"): "verify sheet iso10360-12 --page y.html --out x.csv",
    ("verify artefacts", "--out"): "verify artefacts c.xml --out x.toml",
    ("certificate", "--out"): f"{CERTIFICATE} --out x.xml",
    ("certificate", "--page"): f"{CERTIFICATE} --out y.xml --page x.html",
    ("certificate", "--pdf"): f"{CERTIFICATE} --out y.xml --pdf x.pdf",
    ("fleet prior", "--out"): "fleet prior fleet --out x.toml",
    ("fit", "--out"): "fit m.csv --arm ur10 --model nominal --out x.truearm",
    ("refit", "--out"): "refit m.truearm m.csv --out x.truearm",
    ("predict", "--out"): "predict m.truearm m.csv --out x.csv",
    ("correct", "--out"): "correct m.truearm t.csv --direction command --untrained accept --out x.csv",
    ("export", "--out"): "export m.truearm --out x.urdf",
}


def out_of(row: tuple[str, str]) -> Path:
    return Path(next(word for word in WRITES[row].split() if word.startswith("x.")))


def test_every_file_that_a_command_names_is_read_or_in_the_table():
    table = {(command, option) for command, options in rows() for option in options.split()}
    paths = {(one.command, one.name) for one in declared() if Path in one.types}
    assert {one for one in paths - table if one[1] not in READ} == {("docs", "--run")}


def test_force_is_an_option_where_it_changes_something_and_only_there():
    has_it = {one.command for one in declared() if one.name == "--force"}
    assert has_it == {command for command, _ in of_kind(KEPT)} | {"refit"}


@pytest.mark.parametrize("row", of_kind(KEPT, FREE), ids=" ".join)
def test_what_people_type_or_measure_is_kept(refused, bench, row):
    out = out_of(row)
    out.write_text("precious")
    before = sorted(path.name for path in bench.iterdir())
    refused(WRITES[row].split(), f"{out}: the file exists")
    assert out.read_text() == "precious"
    assert sorted(path.name for path in bench.iterdir()) == before


@pytest.mark.parametrize("row", [("arms", "--out"), ("simulate", "--out"), ("import", "--out"), ("split", "--test")])
def test_force_replaces_it(truearm, bench, row):
    out_of(row).write_text("precious")
    truearm(*WRITES[row].split(), "--force").done()
    assert "precious" not in out_of(row).read_text()


@pytest.mark.parametrize("row", of_kind(OWN), ids=" ".join)
@pytest.mark.parametrize("what", [pytest.param("m.csv", marks=pytest.mark.weekly), "other.truearm"])
def test_what_a_command_makes_again_replaces_its_own_kind_only(truearm, refused, bench, row, what):
    out = out_of(row)
    shutil.copy(what, out)
    (bench / "t.csv").write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n0,-90,90,0,90,0\n")
    refused(WRITES[row].split(), "Try: another name")
    assert out.read_bytes() == Path(what).read_bytes()
    out.unlink()
    for _ in range(2):  # the second time over its own
        ran = truearm(*WRITES[row].split())
        assert ran.code in (0, 1), ran.err


def test_a_model_is_replaced_by_one_of_the_same_arm_and_by_another_with_force(truearm, bench):
    arguments = ["fit", "other.csv", "--arm", "ur10", "--model", "nominal", "--out", "m.truearm"]
    ran = truearm(*arguments)
    assert "a model of another arm: serial numbers 'virtual-research-1' and 'virtual-research-2'" in ran.err
    assert truearm("fit", "m.csv", *arguments[2:]).code == 0
    assert truearm(*arguments, "--force").code == 0
    assert ta.load_model("m.truearm").arm_.serial_number == "virtual-research-2"


def test_a_damaged_model_is_not_replaced_without_force(truearm, refused, bench):
    """Its arm can be read, and nothing tells whose the rest was."""
    fit = ["fit", "m.csv", "--arm", "ur10", "--model", "nominal", "--out", "damaged.truearm"]
    with zipfile.ZipFile("m.truearm") as whole, zipfile.ZipFile("damaged.truearm", "w") as damaged:
        for entry in whole.infolist():
            damaged.writestr(entry, whole.read(entry).replace(b'"training_": {', b'"training": {'))
    refused(fit, "the file exists already, and is not one that this command writes (model", "--force to replace it")
    assert truearm(*fit, "--force").code == 0
    assert ta.load_model("damaged.truearm").arm_.serial_number == "virtual-research-1"


def test_a_model_of_another_type_with_the_same_serial_number_is_not_replaced(truearm, bench):
    """Virtual arms of one preset and seed have the same one, whatever their type; so may those of two makers."""
    assert truearm("simulate", "ur5", "--poses", 30, "--seed", 1, "--out", "ur5.csv").code == 0
    assert truearm("simulate", "ur10", "--poses", 30, "--seed", 1, "--out", "ur10.csv").code == 0
    assert truearm("fit", "ur5.csv", "--arm", "ur5", "--model", "nominal", "--out", "m2.truearm").code == 0
    ran = truearm("fit", "ur10.csv", "--arm", "ur10", "--model", "nominal", "--out", "m2.truearm")
    assert "a model of another arm: arms 'ur5' and 'ur10'" in ran.err
    assert ta.load_model("m2.truearm").arm_.name == "ur5"


def test_a_corrected_arm_file_is_of_the_same_arm(truearm, bench):
    """Without a serial number an arm keeps its identity when its file is corrected, and loses it with its name too."""
    lines = (bench / "m.csv").read_text().splitlines()
    at = lines[0].split(",").index("serial_number")
    kept = [",".join(cell for i, cell in enumerate(line.split(",")) if i != at) for line in lines]
    (bench / "s.csv").write_text("\n".join(kept) + "\n")
    assert truearm("arms", "ur10", "--out", "mine.toml").code == 0
    fit = ["fit", "s.csv", "--model", "nominal", "--out", "n.truearm", "--arm"]
    assert truearm(*fit, "mine.toml").code == 0
    text = (bench / "mine.toml").read_text()
    assert "-612" in text
    corrected = text.replace("-612.0", "-612.2")
    assert corrected != text
    (bench / "mine.toml").write_text(corrected)
    assert truearm(*fit, "mine.toml").code == 0
    (bench / "mine.toml").write_text(text.replace('name = "ur10"', 'name = "left"'))
    assert "a model of another arm: arms 'ur10' and 'left'" in truearm(*fit, "mine.toml").err


INPUTS = [
    ("fit m.csv --arm a.toml --model nominal --out", ["m.csv", "a.toml"]),
    ("fit m.csv --arm a.toml --apply y.toml --force --out", ["m.csv"]),
    ("fit m.csv --arm a.toml --out y.truearm --force --apply", ["a.toml"]),
    ("refit m.truearm m.csv --force --out", ["m.truearm", "m.csv"]),
    ("predict m.truearm m.csv --out", ["m.csv"]),
    ("correct m.truearm m.csv --direction command --out", ["m.csv"]),
    ("export m.truearm --original a.urdf --out", ["a.urdf"]),
    ("import m.csv --force --out", ["m.csv"]),
    ("split m.csv --force --train y.csv --test", ["m.csv"]),
    ("split m.csv --force --test y.csv --train", ["m.csv"]),
    ("simulate ur10 --plan m.csv --force --out", ["m.csv"]),
    ("plan m.truearm --artefact tracker --session m.csv --force --out", ["m.csv"]),
    ("arms a.toml --force --out", ["a.toml"]),
    ("arms a.toml --session m.csv --force --apply", ["a.toml"]),
    ("arms --from-circles m.toml --force --out", ["m.toml"]),
    ("report m.truearm m.html --page", ["m.html"]),
]


@pytest.mark.parametrize(("line", "read"), [(line, one) for line, inputs in INPUTS for one in inputs])
def test_nothing_that_is_read_is_written_over_not_by_force_and_not_by_a_link(refused, bench, line, read):
    (bench / "a.toml").write_bytes((Path(ta.__file__).parent / "arm" / "arms" / "ur10.toml").read_bytes())
    for name in ("a.urdf", "m.toml", "m.html"):
        (bench / name).write_text("read")
    before, link = Path(read).read_bytes(), f"link{Path(read).suffix}"
    (bench / link).symlink_to(read)
    for out in (read, link):
        refused([*line.split(), out], "would be overwritten")
    for other in (line.replace(read, link),) if f" {read}" in line else ():
        refused([*other.split(), read], "would be overwritten")
    assert Path(read).read_bytes() == before
