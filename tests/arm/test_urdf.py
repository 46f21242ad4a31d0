"""URDF: the same tips as Pinocchio gives, there and back without loss, and hostile or broken files refused."""

from pathlib import Path

import numpy as np
import pytest

from refusals import refuses
from truearm.arm import Arm, Chain, list_arms, load_arm
from truearm.arm.catalogue import arm_path
from truearm.arm.urdf import MAX_BYTES, read_urdf, write_urdf
from truearm.errors import InputError
from truearm.identification.terms import gravity_loads, uniform_links

JOINT = '<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{more}</joint>'


def joint(name: str, kind: str, parent: str, child: str, more: str = "") -> str:
    return JOINT.format(name=name, kind=kind, parent=parent, child=child, more=more)


def robot(*parts: str, links: str = "a b c") -> str:
    return f'<robot name="r">{"".join(f"<link name={link!r}/>" for link in links.split())}{"".join(parts)}</robot>'


def write(folder: Path, text: str | bytes) -> Path:
    path = folder / "arm.urdf"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def random_urdf(seed: int) -> str:
    """A robot with all kinds of joints about any axes, fixed links between and a side branch."""
    rng = np.random.default_rng(seed)
    kinds = ["revolute", "continuous", "prismatic", "fixed", *rng.choice(["revolute", "fixed", "prismatic"], 4)]
    rng.shuffle(kinds)
    parts = []
    for i, kind in enumerate(kinds):
        axis = rng.normal(size=3) if rng.random() < 0.6 else rng.choice([-1, 1]) * np.eye(3)[rng.integers(3)]
        xyz, rpy = rng.normal(0, 0.4, 3), rng.uniform(-3, 3, 3)
        more = f'<origin xyz="{fmt(xyz)}" rpy="{fmt(rpy)}"/><axis xyz="{fmt(axis)}"/>'
        more += '<limit lower="-2" upper="2" effort="1" velocity="1"/>' if kind in ("revolute", "prismatic") else ""
        parts.append(joint(f"j{i}", kind, f"l{i}", f"l{i + 1}", more))
    parts.append(joint("side", "revolute", "l2", "branch", '<limit lower="-1" upper="1" effort="1" velocity="1"/>'))
    return robot(*parts, links=" ".join(f"l{i}" for i in range(len(kinds) + 1)) + " branch")


def fmt(numbers: np.ndarray) -> str:
    return " ".join(repr(float(number)) for number in numbers)


@pytest.mark.parametrize("seed", range(50))
def test_tips_and_axes_agree_with_pinocchio(tmp_path, seed):
    pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio (pin) is not installed")
    path = write(tmp_path, random_urdf(seed))
    arm = read_urdf(path, tip="l8")
    model = pinocchio.buildModelFromUrdf(str(path))
    data = model.createData()
    frame = model.getFrameId("l8")
    rng = np.random.default_rng(seed)
    for q in rng.uniform(-2, 2, (4, arm.n_joints)):
        state = pinocchio.neutral(model)
        for name, value, slides in zip(arm.joint_names, q, arm.chain.is_prismatic, strict=True):
            joint = model.joints[model.getJointId(name)]
            # Pinocchio keeps a continuous joint as cosine and sine.
            state[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else [np.cos(value), np.sin(value)]
            assert slides == ("P" in joint.shortname())
        pinocchio.framesForwardKinematics(model, data, state)
        ours = arm.chain.pose([np.where(arm.chain.is_prismatic, 1000 * q, q)])
        theirs = data.oMf[frame]
        np.testing.assert_allclose(ours.tip_in_base[0], 1000 * theirs.translation, atol=1e-9, rtol=0)
        np.testing.assert_allclose(ours.R_base_tip[0], theirs.rotation, atol=1e-12, rtol=0)


def test_derivatives_agree_with_pinocchios_regressor(tmp_path):
    pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio (pin) is not installed")
    write_urdf(load_arm("panda"), tmp_path / "panda.urdf")
    model = pinocchio.buildModelFromUrdf(str(tmp_path / "panda.urdf"))
    data = model.createData()
    tip = model.getFrameId("tip")
    arm = load_arm("panda")
    q = arm.working
    pinocchio.computeJointJacobians(model, data, q)
    pinocchio.updateFramePlacements(model, data)
    J = pinocchio.getFrameJacobian(model, data, tip, pinocchio.LOCAL_WORLD_ALIGNED)[:3]
    ours = arm.chain.tip_derivatives([q]).motion_jacobian[0, 1:-1, 2]
    np.testing.assert_allclose(ours, 1000 * J.T, atol=1e-9, rtol=0)


def test_weight_pulls_as_in_pinocchio(tmp_path):
    """The torques that hold the arm, whatever its axes and fixed links; a branch beside the chain without mass."""
    pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio (pin) is not installed")
    rng = np.random.default_rng(4)
    text = random_urdf(4)
    inertia = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    for i in (0, 1, 3, 4, 5, 6, 7, 8):  # link 2 has none
        mass = f'<origin xyz="{fmt(rng.normal(0, 0.2, 3))}"/><mass value="{rng.uniform(1, 9)}"/>{inertia}'
        text = text.replace(f"<link name='l{i}'/>", f"<link name='l{i}'><inertial>{mass}</inertial></link>")
    path = write(tmp_path, text)
    arm = read_urdf(path, tip="l8")
    model = pinocchio.buildModelFromUrdf(str(path))
    data = model.createData()
    for q in rng.uniform(-2, 2, (4, arm.n_joints)):
        state = pinocchio.neutral(model)
        for name, value in zip(arm.joint_names, q, strict=True):
            joint = model.joints[model.getJointId(name)]
            state[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else [np.cos(value), np.sin(value)]
        holds = pinocchio.computeGeneralizedGravity(model, data, state)
        pulls = gravity_loads(
            arm.chain, [np.where(arm.chain.is_prismatic, 1000 * q, q)], arm.masses, gravity_in_base=[0, 0, -9.81]
        )
        for i, name in enumerate(arm.joint_names):
            ours = (pulls.force_in_joint if arm.chain.is_prismatic[i] else pulls.torque_in_joint)[0, i, 2]
            assert ours == pytest.approx(-holds[model.joints[model.getJointId(name)].idx_v], abs=1e-9)  # N m, N


@pytest.mark.parametrize(
    ("inertial", "said"),
    [
        ("<inertial/>", "the <inertial> of link 'b' has no <mass>"),
        ('<inertial><mass value="-1"/></inertial>', "mass of link 'b' is negative"),
        ('<inertial><mass value="heavy"/></inertial>', "expected a finite number in value"),
        ('<inertial><mass value="1e9"/></inertial>', "at most 100000 kg"),
        ('<inertial><origin xyz="0 0"/><mass value="1"/></inertial>', "centre of mass of link 'b'"),
        ('<inertial><mass value="1"/></inertial><inertial><mass value="1"/></inertial>', "expected one <inertial>"),
    ],
)
def test_a_mass_that_is_none_is_refused(tmp_path, inertial, said):
    text = robot(joint("j", "continuous", "a", "b"), links="a b").replace(
        "<link name='b'/>", f"<link name='b'>{inertial}</link>"
    )
    refuses(said, read_urdf, write(tmp_path, text))


@pytest.mark.parametrize("mass", [None, 0])
def test_links_without_mass_leave_the_masses_unknown(tmp_path, mass):
    inertial = "" if mass is None else '<inertial><mass value="0"/></inertial>'
    text = robot(joint("j", "continuous", "a", "b"), links="a b").replace(
        "<link name='b'/>", f"<link name='b'>{inertial}</link>"
    )
    assert read_urdf(write(tmp_path, text)).masses is None


def test_masses_and_gravity_go_there_and_back(tmp_path):
    arm = load_arm("ur5")
    heavy = Arm("any", arm.chain, masses=uniform_links(arm.chain, kg_per_m=20.0), gravity_in_base=[0, 1, 1])
    write_urdf(heavy, tmp_path / "arm.urdf")
    again = read_urdf(tmp_path / "arm.urdf")
    np.testing.assert_array_equal(again.gravity_direction, heavy.gravity_direction)
    np.testing.assert_array_equal(again.masses.mass_kg, heavy.masses.mass_kg)
    np.testing.assert_allclose(again.masses.centre_in_joint_mm, heavy.masses.centre_in_joint_mm, rtol=1e-15)
    bad = (tmp_path / "arm.urdf").read_text().replace('gravity_in_base="', 'gravity_in_base="down ')
    refuses("the direction of gravity: expected 3 finite numbers", read_urdf, write(tmp_path, bad))


# There and back


@pytest.mark.parametrize("name", list_arms())
def test_every_arm_of_the_catalogue_goes_there_and_back(tmp_path, name):
    arm = load_arm(name)
    write_urdf(arm, tmp_path / "arm.urdf")
    assert_same_arm(arm, read_urdf(tmp_path / "arm.urdf"))


@pytest.mark.parametrize("seed", range(10))
def test_any_arm_goes_there_and_back(tmp_path, seed):
    arm = read_urdf(write(tmp_path, random_urdf(seed)), tip="l8")
    write_urdf(arm, tmp_path / "back.urdf")
    assert_same_arm(arm, read_urdf(tmp_path / "back.urdf"))


def assert_same_arm(one: Arm, other: Arm) -> None:
    for name in ("name", "title", "source", "joint_names"):
        assert getattr(one, name) == getattr(other, name)
    np.testing.assert_array_equal(one.chain.is_prismatic, other.chain.is_prismatic)
    np.testing.assert_allclose(one.limits, other.limits, rtol=1e-15)
    np.testing.assert_allclose(one.working, other.working, rtol=1e-15)
    q = np.random.default_rng(0).uniform(-3, 3, (20, one.n_joints)) * np.where(one.chain.is_prismatic, 100, 1)
    first, second = one.chain.pose(q), other.chain.pose(q)
    np.testing.assert_allclose(first.tip_in_base, second.tip_in_base, atol=1e-9, rtol=0)
    np.testing.assert_allclose(first.R_base_tip, second.R_base_tip, atol=1e-12, rtol=0)


def test_names_with_signs_of_xml_survive(tmp_path):
    arm = Arm('a<b & "c"', load_arm("ur5").chain, title="größer > kleiner", joint_names=tuple("<>&'ab"))
    write_urdf(arm, tmp_path / "arm.urdf")
    assert_same_arm(arm, read_urdf(tmp_path / "arm.urdf"))


def test_one_limit_only_cannot_be_written(tmp_path):
    arm = Arm("half", load_arm("ur5").chain, upper=np.full(6, 1.0))
    refuses(r"joint J1 has one limit only.*\.toml", write_urdf, arm, tmp_path / "arm.urdf")
    assert list(tmp_path.iterdir()) == []


def test_a_control_character_is_refused_before_anything_is_written(tmp_path):
    with pytest.raises(InputError, match="not valid XML"):
        write_urdf(Arm("any", load_arm("ur5").chain, serial_number="a\x01b"), tmp_path / "arm.urdf")
    assert list(tmp_path.iterdir()) == []


def test_pinocchio_reads_what_we_write(tmp_path):
    pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio (pin) is not installed")
    slide = Chain(np.tile(np.eye(4), (3, 1, 1)), [0, 0, 7], [True, False])
    write_urdf(Arm("slide", slide), tmp_path / "arm.urdf")
    model = pinocchio.buildModelFromUrdf(str(tmp_path / "arm.urdf"))
    assert [joint.shortname() for joint in model.joints][1:] == ["JointModelPZ", "JointModelRUBZ"]


# What it reads


def test_metres_become_millimetres_and_limits_too(tmp_path):
    slide = '<origin xyz="0.1 0 0"/><axis xyz="0 0 2"/><limit lower="-0.05" upper="0.2"/>'
    arm = read_urdf(write(tmp_path, robot(joint("s", "prismatic", "a", "b", slide), links="a b")))
    np.testing.assert_allclose(arm.limits, [[-50, 200]])
    np.testing.assert_allclose(arm.chain.tip_in_base([[30.0]]), [[100, 0, 30]], atol=1e-12)


def test_defaults_are_those_of_urdf(tmp_path):
    # no origin: none; no axis: x; no limits: none here; one of two: the other is zero
    text = robot(joint("p", "prismatic", "a", "b"), joint("q", "revolute", "b", "c", '<limit upper="1"/>'))
    arm = read_urdf(write(tmp_path, text))
    np.testing.assert_allclose(arm.chain.tip_in_base([[7.0, 0.0]]), [[7, 0, 0]], atol=1e-12)
    np.testing.assert_array_equal(arm.limits, [[-np.inf, np.inf], [0, 1]])


def test_the_working_pose_is_zero_or_the_limit_next_to_it(tmp_path):
    arm = read_urdf(
        write(tmp_path, robot(joint("q", "revolute", "a", "b", '<limit lower="-3" upper="-1"/>'), links="a b"))
    )
    np.testing.assert_array_equal(arm.working, [-1])


def test_a_floating_or_mimicking_joint_beside_the_chain_does_not_matter(tmp_path):
    text = robot(
        joint("q", "continuous", "a", "b"),
        joint("loose", "floating", "a", "c"),
        joint("finger", "revolute", "b", "d", '<mimic joint="q"/>'),
        links="a b c d",
    )
    assert read_urdf(write(tmp_path, text), tip="b").joint_names == ("q",)


def test_base_and_tip_choose_a_part(tmp_path):
    text = robot(joint("q", "continuous", "a", "b"), joint("r", "continuous", "b", "c"))
    path = write(tmp_path, text)
    assert read_urdf(path).joint_names == ("q", "r")
    assert read_urdf(path, base="b").joint_names == ("r",)
    assert read_urdf(path, tip="b").joint_names == ("q",)


def test_the_links_may_stand_after_the_files_name(tmp_path):
    text = robot(joint("q", "continuous", "a", "b"), joint("r", "continuous", "b", "c"), joint("s", "fixed", "b", "d"))
    path = write(tmp_path, text.replace("</robot>", "<link name='d'/></robot>"))
    assert load_arm(f"{path}::c").joint_names == ("q", "r")
    assert load_arm(f"{path}:b:c").joint_names == ("r",)
    assert load_arm(f"{path}:b:c", base="a").joint_names == ("q", "r")
    assert load_arm(Path(f"{path}::d")).joint_names == ("q",)
    assert load_arm(path, tip="c").joint_names == ("q", "r")
    assert arm_path(f"{path}:b:c") == arm_path(f"{path}::") == arm_path(path) == path
    assert arm_path("C:\\robots\\a.URDF::tool0") == Path("C:\\robots\\a.URDF")
    assert load_arm(path).joint_names == ("q", "r")
    refuses("no link 'x'", load_arm, f"{path}::x")
    for arm in ("ur5", "arm.toml"):
        refuses("only a URDF or MJCF has links to choose", load_arm, arm, tip="c")


def test_a_file_may_state_its_links_itself(tmp_path):
    """An exported file is read without naming them; what is named goes first."""
    text = robot(joint("q", "continuous", "a", "b"), joint("s", "fixed", "a", "c"), '<truearm base="a" tip="b"/>')
    path = write(tmp_path, text)
    assert read_urdf(path).joint_names == ("q",)
    refuses("no moving joint", read_urdf, path, tip="c")


# What it refuses

TURN = joint("q", "continuous", "a", "b")


def hinge(more: str, kind: str = "continuous") -> str:
    """A robot of one joint, with more in it."""
    return robot(joint("q", kind, "a", "b", more), links="a b")


BROKEN = {
    "doctype": ('<!DOCTYPE r [<!ENTITY x "y">]><robot name="r"/>', "line 1: truearm reads no XML with a DOCTYPE"),
    "bomb": (
        '<?xml version="1.0"?>\n<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]>\n<robot name="&b;"/>',
        "line 2: truearm reads no XML with a DOCTYPE or ENTITY",
    ),
    "outside file": ('<!DOCTYPE r SYSTEM "file:///etc/passwd"><robot name="r"/>', "DOCTYPE"),
    "utf-16 doctype": ('<?xml version="1.0" encoding="utf-16"?><!DOCTYPE r><robot/>'.encode("utf-16"), "DOCTYPE"),
    "xacro": (
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">\n<xacro:macro name="m"/></robot>',
        r"line 2: .* got a xacro file: it has <xacro:macro>\. Try: expand it first",
    ),
    "no xml": ("name = 'r'", "line 1: not valid XML"),
    "cut off": ('<robot name="r">\n<link name="a"/>\n', "line 3: not valid XML: no element found"),
    "empty": ("", "not valid XML: no element found"),
    "unknown encoding": ('<?xml version="1.0" encoding="klingon"?><robot/>', "not valid XML: unknown encoding"),
    "other root": ("<sdf/>", "starts with <robot>, got <sdf>"),
    "no name": (f"<robot><link name='a'/><link name='b'/>{TURN}</robot>", "<robot> has no 'name'"),
    "link without name": ('<robot name="r"><link/></robot>', "<link> has no 'name'"),
    "joint without type": ('<robot name="r"><joint name="q"/></robot>', "<joint> has no 'type'"),
    "two links": (robot(links="a a"), "2 links have the name 'a'"),
    "two joints": (robot(TURN, joint("q", "fixed", "b", "c")), "2 joints have the name 'q'"),
    "unknown type": (robot(joint("q", "hinge", "a", "b")), "unknown type 'hinge'.*revolute, continuous, prismatic"),
    "floating": (
        robot(joint("p", "continuous", "a", "b"), joint("q", "floating", "b", "c"), '<truearm base="a" tip="c"/>'),
        "joint 'q' is floating",
    ),
    "no link": ('<robot name="r"/>', "the robot has no <link>"),
    "no joint": (robot(links="a"), "the robot has no <joint>"),
    "mimic": (hinge('<mimic joint="x"/>'), "joint 'q' mimics"),
    "no parent": (
        '<robot name="r"><link name="a"/><joint name="q" type="fixed"><child link="a"/></joint></robot>',
        "joint 'q' has no <parent>",
    ),
    "unknown link": (robot(joint("q", "fixed", "a", "x")), "has the child 'x', but there is no such link"),
    "two parents": (
        robot(joint("q", "fixed", "a", "c"), joint("p", "fixed", "b", "c")),
        "child of two joints, 'q' and",
    ),
    "circle": (robot(joint("q", "fixed", "a", "b"), joint("p", "fixed", "b", "a"), links="a b"), "form a loop"),
    "circle beside": (
        robot(
            joint("q", "fixed", "a", "b"), joint("p", "fixed", "b", "a"), joint("s", "fixed", "b", "c"), links="a b c d"
        ),
        "no moving joint",
    ),
    "two arms": (
        robot(joint("q", "continuous", "a", "b"), joint("p", "continuous", "a", "c")),
        r"2 arms could be meant, the longest of 1 joint, with the tips b, c.*FILE\.urdf::b",
    ),
    "two robots": (
        robot(joint("q", "continuous", "a", "b"), joint("p", "continuous", "c", "d"), links="a b c d"),
        r"2 arms could be meant.* b, d",
    ),
    "fingers alone": (hinge("", "prismatic").replace("'q'", "'finger'").replace('"q"', '"finger"'), "fingers"),
    "nothing moves": (robot(joint("q", "fixed", "a", "b"), links="a b"), "no moving joint"),
    "endless axis": (hinge('<axis xyz="1e200 0 0"/>'), "axis of joint 'q' is no direction"),
    "endless link": (hinge('<origin xyz="1e30 0 0"/>'), "check their units"),
    "zero axis": (hinge('<axis xyz="0 0 0"/>'), "axis of joint 'q' is no direction"),
    "text": (
        hinge('<origin xyz="0 zero 0"/>'),
        "origin of joint 'q': expected 3 finite numbers in xyz, got '0 zero 0'",
    ),
    "two numbers": (hinge('<axis xyz="0 1"/>'), "expected 3 finite"),
    "nan": (hinge('<origin rpy="nan 0 0"/>'), "expected 3 finite"),
    "limit": (hinge('<limit lower="1" upper="0"/>', "revolute"), "lower limit of q must be below"),
    "limit text": (
        hinge('<limit lower="x"/>', "revolute"),
        "limit of joint 'q': expected a finite number in lower, got 'x'",
    ),
    "two origins": (hinge("<origin/><origin/>"), "expected one <origin>"),
    "working": (robot(TURN, '<truearm><working joint="x" position="0"/></truearm>', links="a b"), "joint 'x' that"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_file_is_refused_with_its_name_and_the_reason(tmp_path, case):
    text, message = BROKEN[case]
    path = write(tmp_path, text)
    assert refuses(message, read_urdf, path).file == path


def test_numbers_loops_links_and_files_that_cannot_be_are_refused(tmp_path):
    refuses("line 3: the origin", read_urdf, write(tmp_path, hinge('\n\n<origin xyz="1 2"/>')))
    loop = write(tmp_path, robot(joint("q", "fixed", "a", "b"), joint("p", "fixed", "b", "a")))
    refuses("form a loop", read_urdf, loop, base="c", tip="a")
    path = write(tmp_path, robot(TURN, joint("p", "fixed", "a", "c")))
    refuses(r"no link 'x'\. Try: use one of a, b, c", read_urdf, path, tip="x")
    refuses("'c' is not connected to 'b', but to 'a'", read_urdf, path, base="b", tip="c")
    refuses("starts with <robot>", read_urdf, write(tmp_path, "<a>" * 200_000 + "</a>" * 200_000))
    refuses("does not exist", read_urdf, tmp_path / "none.urdf")
    refuses("got a folder", read_urdf, tmp_path)
    refuses("larger than 5 MB", read_urdf, write(tmp_path, b" " * (MAX_BYTES + 1)))


def test_many_links_take_no_longer_than_their_number(tmp_path):
    # 20,000 joints in a row: anything quadratic would take minutes.
    n = 20_000
    rows = (joint(f"j{i}", "fixed", f"l{i}", f"l{i + 1}") for i in range(n))
    refuses("no moving joint", read_urdf, write(tmp_path, robot(*rows, links=" ".join(f"l{i}" for i in range(n + 1)))))
