"""Kinematics yaml of Franka and UFACTORY: read as an arm, and written with the arm that was built."""

import numpy as np
import pytest
import yaml

import truearm as ta
from refusals import refuses
from truearm.arm.kinematics_yaml import read_kinematics_yaml
from truearm.wings.exports.formats import kinematics_yaml

H = 1.570796326794897
PANDA = [(0, 0, 0.333, 0), (0, 0, 0, -H), (0, -0.316, 0, H), (0.0825, 0, 0, H), (-0.0825, 0.384, 0, -H)]
PANDA += [(0, 0, 0, H), (0.088, 0, 0, H), (0, 0, 0.107, 0)]
XARM6 = [(0, 0, 0.267, 0, 0, 0), (0, 0, 0, -1.5708, 0, 0), (0.053, -0.2845, 0, 0, 0, 0)]
XARM6 += [(0.0775, 0.3425, 0, -1.5708, 0, 0), (0, 0, 0, 1.5708, 0, 0), (0.076, 0.097, 0, -1.5708, 0, 0)]


def franka() -> str:
    lines = ["# of the description\r"]
    for i, (x, y, z, roll) in enumerate(PANDA, 1):
        lines += [f"joint{i}:\r", "  kinematic:\r", f"    x: {x}   # m\r", f"    y: {y}\r", f"    z: {z}\r"]
        lines += [f"    roll: {roll}\r", "    pitch: 0\r", "    yaw: 0\r"]
    return "\n".join([*lines, ""])


def xarm() -> str:
    """As UFACTORY's script dumps it: keys in alphabetical order."""
    poses = {
        f"joint{i}": dict(sorted(zip(("x", "y", "z", "roll", "pitch", "yaw"), map(float, pose), strict=True)))
        for i, pose in enumerate(XARM6, 1)
    }
    return yaml.safe_dump({"kinematics": poses})


@pytest.fixture(scope="module", params=[franka, xarm], ids=["franka", "xarm"])
def source(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("driver") / "kinematics.yaml"
    path.write_bytes(request.param().encode())
    return path


def poses(n: int, n_joints: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(-1.2, 1.2, (n, n_joints))


@pytest.fixture(scope="module")
def built(source) -> tuple[ta.KinematicModel, np.ndarray]:
    nominal = read_kinematics_yaml(source)
    motions = np.random.default_rng(4).normal(size=(nominal.chain.n_places, 6)) * ([1e-3] * 3 + [0.5] * 3)
    q = poses(80, nominal.n_joints)
    chain = nominal.chain.with_tip(np.array([10.0, 0.0, 60.0])).with_motions(motions)
    return ta.KinematicModel(nominal).fit(q, chain.tip_in_base(q)), q


def test_they_are_the_arms_of_the_catalogue(source):
    arm = read_kinematics_yaml(source)
    known = ta.load_arm("panda" if arm.n_joints == 7 else "xarm6")
    q = poses(20, arm.n_joints)
    flange = known.chain.with_tip(np.zeros(3))
    # UFACTORY's manual has an upper arm that is 0.1 mm longer than its description.
    np.testing.assert_allclose(
        arm.chain.tip_in_base(q), flange.tip_in_base(q), rtol=0, atol=1e-6 if arm.n_joints == 7 else 1.0
    )
    assert ta.load_arm(source).joint_names == tuple(f"joint{i + 1}" for i in range(arm.n_joints))


def test_the_file_has_the_arm_that_was_built(source, built, tmp_path):
    model, q = built
    out = tmp_path / "built.yaml"
    rigid = kinematics_yaml.write(model, out, source=source).rigid
    again = ta.load_arm(out)
    tool = rigid.arm.chain.tip_in_flange
    np.testing.assert_allclose(
        again.chain.with_tip(tool).tip_in_base(q), rigid.arm.chain.tip_in_base(q), rtol=0, atol=1e-9
    )  # mm
    np.testing.assert_allclose(kinematics_yaml.tips(out, q), rigid.arm.chain.tip_in_base(q), rtol=0, atol=1e-9)
    assert ta.check_export(model, out).agrees
    before = source.read_bytes().decode().splitlines(keepends=True)
    after = out.read_bytes().decode().splitlines(keepends=True)[4:]
    names = [line.partition(":")[0] for line in before]
    assert [line.partition(":")[0] for line in after] == names
    assert [line.rpartition("#")[2] for line in after if "#" in line] == [
        line.rpartition("#")[2] for line in before if "#" in line
    ]
    assert after[:8] == before[:8] or source.read_bytes().startswith(b"kinematics")  # joint 1 is the base's


def test_an_earlier_export_is_a_source_too(source, built, tmp_path):
    model, _ = built
    once, twice = tmp_path / "once.yaml", tmp_path / "twice.yaml"
    for given, out in ((source, once), (once, twice)):
        ta.export(model, out, format="kinematics-yaml", source=given)
    assert twice.read_text().count("truearm-export") == 1


def test_a_model_that_is_the_nominal_arm_changes_no_number(source, tmp_path):
    nominal = read_kinematics_yaml(source)
    q = poses(60, nominal.n_joints)
    model = ta.NominalModel(nominal).fit(q, nominal.chain.tip_in_base(q))
    out = tmp_path / "same.yaml"
    ta.export(model, out, format="kinematics-yaml", source=source)
    assert out.read_bytes().split(b"\n", 4)[4] == source.read_bytes()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: 1\n", "expected a UR's kinematics yaml"),
        ("joint1: {x: 0}\n", "y, z, roll, pitch, yaw missing"),
        ("kinematics:\n  joint1: {x: 0}\n  joint3: {x: 0}\n", "expected the joints joint1"),
        ("[1]\n", "got a list"),
        (franka().replace("0.333", "333"), "within 5 m"),
        (franka().replace("0.333", ".nan"), "as a finite number"),
        ("a: &a 1\nb: *a\n", "anchors"),
    ],
)
def test_another_file_is_refused(text, said, tmp_path):
    (tmp_path / "k.yaml").write_text(text)
    error = refuses(said, ta.load_arm, tmp_path / "k.yaml")
    assert error.file == tmp_path / "k.yaml"


def test_what_cannot_be_exported_is_refused(source, built, tmp_path):
    model, _ = built

    def export(**options):
        return ta.export(model, tmp_path / "out.yaml", format="kinematics-yaml", **options)

    refuses("maker's file is not stated", export)
    refuses("own base frame", export, source=source, frame="reference")
    other = tmp_path / "other.yaml"
    other.write_text(xarm() if model.arm_.n_joints == 7 else franka())
    refuses("joints", export, source=other)
    assert not (tmp_path / "out.yaml").exists()
