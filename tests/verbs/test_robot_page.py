"""The page for robots: its commands bring a model into a program, a URDF and a C file."""

import contextlib
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import truearm as ta
from page_transcripts import BLOCK, DOCS, blocks, check_printed, commands
from truearm.wings.exports.targets.targets import read_targets

PAGE = (DOCS / "start" / "robot.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def virtual():
    """The arm that `simulate` measures on the page."""
    return ta.VirtualArm.draw(ta.load_arm("ur10"), "research", seed=0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, truearm, undrawn):
    """Where the page's commands were run."""
    folder = tmp_path_factory.mktemp("robot")
    with contextlib.chdir(folder):
        for kind, name, text in BLOCK.findall(PAGE):
            if name:
                Path(name).write_text(text, encoding="utf-8")
            elif kind == "console":
                for (_, *arguments), shown in commands(text):
                    ran = truearm(*arguments).done()
                    check_printed(shown, ran.out.splitlines())
    return folder


def test_the_corrected_program_brings_the_arm_where_the_nominal_arm_would_go(folder, virtual):
    sent = [
        [float(q) for q in line.split("[")[1].split("]")[0].split(",")]
        for line in (folder / "program.script").read_text().splitlines()
        if line.strip().startswith("movej")
    ]
    model = ta.load_model(folder / "ur10.truearm")
    planned = read_targets(folder / "program.csv").joints
    assert len(sent) == len(planned) == 3
    off = np.linalg.norm(virtual.true_tip(np.array(sent)) - model.predict_nominal(planned), axis=1)
    before = np.linalg.norm(virtual.true_tip(planned) - model.predict_nominal(planned), axis=1)
    assert off.mean() < 0.3 * before.mean()


def test_pinocchio_loads_the_urdf(folder):
    pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio is not installed")
    scope = {}
    with contextlib.chdir(folder):
        exec(blocks("start/robot.md", "python")[0], scope)  # the page's own lines
    robot = scope["robot"]
    data, q = robot.createData(), read_targets(folder / "program.csv").joints[0]
    pinocchio.forwardKinematics(robot, data, q)
    pinocchio.updateFramePlacements(robot, data)
    tip = 1000 * data.oMf[robot.getFrameId("tip")].translation
    np.testing.assert_allclose(tip, ta.load_arm(folder / "ur10.urdf").chain.tip_in_base(q[None])[0], atol=1e-6)  # mm


def test_the_c_file_compiles_and_has_the_functions_of_the_page_on_exports(folder):
    if shutil.which("cc") is None:
        pytest.skip("no C compiler is installed")
    source = (folder / "ur10.c").read_text()
    exports = (DOCS / "export.md").read_text(encoding="utf-8")
    functions = re.findall(r"^\| `(truearm_\w+)\(", exports, flags=re.MULTILINE)
    assert len(functions) == 5
    for function in functions:
        assert re.search(rf"^\w+ {function}\(", source, flags=re.MULTILINE), function
    command = re.search(r"`(cc [^`]*)` compiles", PAGE)[1]
    subprocess.run(shlex.split(command), cwd=folder, check=True, timeout=60)
