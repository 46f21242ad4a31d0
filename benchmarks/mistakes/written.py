"""Files written: over what people typed or measured, over other arms, over what is read; what may be written again."""

from __future__ import annotations

import itertools
import shutil
from pathlib import Path

import truearm as ta
from benchmarks.mistakes import mistake, right, seen
from benchmarks.rows import scratch
from truearm.files.atomic_write import PART, _own_parts, atomic_file

_NUMBERS = itertools.count(1)


def made() -> Path:
    """A folder with sessions and nominal models of two UR10: a.csv, a.truearm, b.csv, b.truearm."""
    folder = scratch() / "written"
    if folder.exists():
        return folder
    folder.mkdir()
    for name, arm_seed in (("a", 1), ("b", 2)):
        session = ta.simulate("ur10", poses=30, seed=1, arm_seed=arm_seed).session
        session.save(folder / f"{name}.csv")
        ta.fit("ur10", session, model="nominal").save(folder / f"{name}.truearm")
    return folder


def copy_of(name: str) -> Path:
    """A copy of one of these files, which a case may write over."""
    new = made() / f"copy-{next(_NUMBERS)}{Path(name).suffix}"
    shutil.copy(made() / name, new)
    return new


def fit_to(session: str, out: Path) -> str:
    return seen("fit", made() / f"{session}.csv", "--arm", "ur10", "--model", "nominal", "--out", out)


@mistake("the arm file that a person edited is written a second time", said="the file exists already")
def arm_file_again() -> str:
    out = made() / "my-arm.toml"
    out.write_text("# measured with a ruler\n")
    return seen("arms", "ur10", "--out", out)


@mistake("a table is imported into the session of another day", said="the file exists already")
def import_again() -> str:
    return seen("import", made() / "a.csv", "--out", copy_of("b.csv"))


@mistake("a plan is planned over the readings that were filled in", said="the file exists already")
def plan_again() -> str:
    return seen("plan", "ur10", "--artefact", "tracker", "--out", copy_of("a.csv"))


@mistake("a refit is written over the model that it reads, by a link", said="would be overwritten")
def refit_in_place() -> str:
    model = copy_of("a.truearm")
    link = model.with_name(f"link-{model.name}")
    link.symlink_to(model)
    return seen("refit", model, made() / "a.csv", "--out", link)


@mistake("the fit of one arm is written over the model of another", said="a model of another arm")
def other_arm() -> str:
    return fit_to("b", copy_of("a.truearm"))


@mistake("a model is written over a session", said="not one that this command writes")
def model_over_session() -> str:
    return fit_to("a", copy_of("b.csv"))


@mistake("predicted points are written over a session", said="not one that this command writes")
def points_over_session() -> str:
    return seen("predict", made() / "a.truearm", made() / "a.csv", "--out", copy_of("b.csv"))


@mistake("an export is written over the robot's own URDF", said="not one that this command writes")
def export_over_urdf() -> str:
    out = made() / "robot.urdf"
    out.unlink(missing_ok=True)
    seen("arms", "ur10", "--out", out)
    return seen("export", made() / "a.truearm", "--out", out)


@mistake("a writer that was killed leaves a hidden file")
def hidden_file() -> bool:
    left = made() / f"{_own_parts()}left-12345678.csv"
    left.write_text("half")
    with atomic_file(made() / "whole.csv") as beside:
        beside.write_text("whole")
    return not any(made().glob(f"{PART}*"))


@right("a model is fitted again to the same name", unsaid="another arm|exists")
def fit_again() -> str:
    return fit_to("a", copy_of("a.truearm"))


@right("a model is fitted again with an arm file that was corrected", unsaid="another arm|exists")
def corrected_arm_file() -> str:
    arm, out = made() / "corrected.toml", copy_of("a.truearm")
    arm.unlink(missing_ok=True)
    seen("arms", "ur10", "--out", arm)
    arm.write_text(arm.read_text().replace("-612.0", "-612.1"))
    return seen("fit", made() / "a.csv", "--arm", arm, "--model", "nominal", "--out", out)


@right("points are predicted again to the same name", unsaid="exists")
def predict_again() -> str:
    arguments = ("predict", made() / "a.truearm", made() / "a.csv", "--out", made() / "points.csv")
    seen(*arguments)
    return seen(*arguments)


@right("a model is exported again to the same name", unsaid="exists")
def export_again() -> str:
    arguments = ("export", made() / "a.truearm", "--out", made() / "exported.urdf")
    seen(*arguments)
    return seen(*arguments)


@right("a refit is written to a name of its own", unsaid="exists|overwritten")
def refit_elsewhere() -> str:
    return seen("refit", made() / "a.truearm", made() / "a.csv", "--out", made() / "refitted.truearm")


@right("a session is simulated again with --force", unsaid="exists")
def simulate_with_force() -> str:
    return seen("simulate", "ur10", "--poses", 20, "--out", copy_of("a.csv"), "--force")
