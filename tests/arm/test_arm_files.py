"""Arm files in TOML: units in the names, there and back without loss, every broken rule named with its key."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from refusals import refuses
from truearm.arm import Arm, Chain, LinkMasses, chain_from_dh, chain_from_mdh, list_arms, load_arm, read_arm, write_arm
from truearm.arm.rigid_motions import frame_from_xyz_rpy
from truearm.errors import InputError
from truearm.identification.terms import gravity_torques, uniform_links

GOOD = """
name = "two"
convention = "dh"
tip_mm = [0, 0, 50]

[[joints]]
type = "revolute"
a_mm = 400
d_mm = 10.0
alpha_deg = 90
theta_deg = 5
min_deg = -170
max_deg = 170
working_deg = 30

[[joints]]
name = "slide"
type = "prismatic"
a_mm = 0
d_mm = 0
alpha_deg = 0
min_mm = -5
max_mm = 300
working_mm = 20
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "arm.toml"
    path.write_text(text, encoding="utf-8")
    return path


def changed(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new, 1)


def test_a_file_is_what_it_says(tmp_path):
    arm = read_arm(write(tmp_path, GOOD))
    chain = chain_from_dh(
        a=[400, 0],
        d=[10, 0],
        alpha=[np.pi / 2, 0],
        theta=np.deg2rad([5, 0]),
        kinds=["revolute", "prismatic"],
        tip_in_flange=[0, 0, 50],
    )
    assert arm.name == "two"
    assert arm.joint_names == ("J1", "slide")
    q = np.array([[0.3, 70.0]])
    np.testing.assert_allclose(arm.chain.tip_in_base(q), chain.tip_in_base(q), atol=1e-12)
    np.testing.assert_allclose(arm.limits, [[np.deg2rad(-170), np.deg2rad(170)], [-5, 300]], rtol=1e-15)
    np.testing.assert_allclose(arm.working, [np.deg2rad(30), 20], rtol=1e-15)


@pytest.mark.parametrize(
    ("millimetres", "other"),
    [
        ("a_mm = 400", "a_m = 0.4"),
        ("alpha_deg = 90", f"alpha_rad = {np.pi / 2}"),
        ("theta_deg = 5", f"theta_rad = {np.deg2rad(5)}"),
        ("tip_mm = [0, 0, 50]", "tip_m = [0, 0, 0.05]"),
        ("max_mm = 300", "max_m = 0.3"),
        ("min_deg = -170", f"min_rad = {np.deg2rad(-170)}"),
        ("working_mm = 20", "working_m = 0.02"),
    ],
)
def test_the_unit_is_what_the_key_says(tmp_path, millimetres, other):
    one, two = read_arm(write(tmp_path, GOOD)), read_arm(write(tmp_path, changed(millimetres, other)))
    q = np.array([[0.3, 70.0]])
    np.testing.assert_allclose(two.chain.tip_in_base(q), one.chain.tip_in_base(q), atol=1e-12)
    np.testing.assert_allclose(two.limits, one.limits, rtol=1e-14)
    np.testing.assert_allclose(two.working, one.working, rtol=1e-14)


def test_base_and_flange_are_frames(tmp_path):
    text = GOOD + "[base]\nxyz_m = [0.1, 0, 0]\nrpy_deg = [0, 0, 90]\n[flange]\nxyz_mm = [0, 0, 5]\n"
    plain, framed = read_arm(write(tmp_path, GOOD)), read_arm(write(tmp_path, text))
    q = np.array([[0.3, 70.0]])
    x, y, z = plain.chain.with_tip([0, 0, 55]).tip_in_base(q)[0]
    np.testing.assert_allclose(framed.chain.tip_in_base(q)[0], [100 - y, x, z], atol=1e-11)


def test_a_fixed_joint_is_folded_in(tmp_path):
    fixed = '[[joints]]\ntype = "fixed"\na_mm = 0\nd_mm = 0\nalpha_deg = 0\ntheta_deg = 90\n'
    arm = read_arm(write(tmp_path, GOOD + fixed))
    assert arm.joint_names == ("J1", "slide")
    q = np.array([[0.3, 70.0]])
    plain = read_arm(write(tmp_path, GOOD))
    np.testing.assert_allclose(arm.chain.tip_in_base(q), plain.chain.tip_in_base(q), atol=1e-12)


def test_modified_rows_hold_what_comes_before_the_joint(tmp_path):
    arm = read_arm(write(tmp_path, changed('"dh"', '"mdh"')))
    chain = chain_from_mdh(
        a=[400, 0],
        d=[10, 0],
        alpha=[np.pi / 2, 0],
        theta=np.deg2rad([5, 0]),
        kinds=["revolute", "prismatic"],
        tip_in_flange=[0, 0, 50],
    )
    q = np.array([[0.3, 70.0]])
    np.testing.assert_allclose(arm.chain.tip_in_base(q), chain.tip_in_base(q), atol=1e-12)


def test_without_a_working_pose_it_is_zero_or_the_limit_next_to_it(tmp_path):
    text = changed("working_deg = 30\n", "").replace("working_mm = 20\n", "").replace("min_mm = -5", "min_mm = 7")
    np.testing.assert_array_equal(read_arm(write(tmp_path, text)).working, [0, 7])


MASSES = """
name = "two"
convention = "dh"
gravity_in_base = [0, -2, 0]

[[joints]]
type = "revolute"
a_mm = 400
d_mm = 0
alpha_deg = 0
theta_deg = 30
mass_kg = 2.0
centre_of_mass_mm = [-200, 0, 0]

[[joints]]
type = "fixed"
a_mm = 100
d_mm = 0
alpha_deg = 90
mass_kg = 1.0
centre_of_mass_m = [0, 0, 0]

[[joints]]
type = "revolute"
a_mm = 300
d_mm = 0
alpha_deg = 0
mass_kg = 0
"""


def test_masses_stand_in_the_frames_at_the_ends_of_the_rows(tmp_path):
    """By hand: an arm in a wall's plane, its first link along x at -30 deg, 2 kg at 200 mm and 1 kg at 500 mm."""
    arm = read_arm(write(tmp_path, MASSES))
    assert arm.n_joints == 2
    np.testing.assert_array_equal(arm.masses.mass_kg, [3, 0])
    np.testing.assert_array_equal(arm.gravity_direction, [0, -1, 0])
    torque = gravity_torques(
        arm.chain, [np.radians([-30, 0]), np.radians([60, 0])], arm.masses, gravity_in_base=[0, -10, 0]
    )
    np.testing.assert_allclose(torque[:, 0, 2], [-10 * (2 * 0.2 + 1 * 0.5), 0], atol=1e-12)
    write_arm(arm, tmp_path / "again.toml", convention="mdh")
    assert_same_arm(arm, read_arm(tmp_path / "again.toml"))


def test_a_link_s_middle_is_half_its_row_back(tmp_path):
    """In a standard table the middle of a link along x lies at -a/2 of its row's end."""
    chain = load_arm("ur10").chain
    uniform = uniform_links(chain, kg_per_m=1.0)
    arm = Arm("ur10", chain, masses=uniform)
    write_arm(arm, tmp_path / "arm.toml")
    assert "centre_of_mass_mm = [306.0, 0.0, 0.0]" in (tmp_path / "arm.toml").read_text()  # a_2 = -612 mm
    assert_same_arm(arm, read_arm(tmp_path / "arm.toml"))


def test_an_arm_stands_upright_and_its_masses_are_not_known_unless_it_says_so(tmp_path):
    arm = read_arm(write(tmp_path, GOOD))
    assert arm.masses is None
    np.testing.assert_array_equal(arm.gravity_direction, [0, 0, -1])


@pytest.mark.parametrize("gravity", [[0, 0, 0], [0, 0], [0, 0, np.nan], [0, 0, np.inf], 9.81])
def test_gravity_needs_a_direction(gravity):
    refuses("gravity as a direction of three numbers", Arm, "any", load_arm("ur5").chain, gravity_in_base=gravity)


def test_masses_of_nothing_but_zeros_are_not_known_whatever_file_states_them(tmp_path):
    path = write(tmp_path, MASSES.replace("mass_kg = 2.0", "mass_kg = 0").replace("mass_kg = 1.0", "mass_kg = 0"))
    arm = read_arm(path)
    assert arm.masses is None
    for name in ("a.toml", "a.urdf"):
        none = Arm("any", arm.chain, masses=LinkMasses(np.zeros(2), np.zeros((2, 3))))
        write_arm(none, tmp_path / name)
        assert read_arm(tmp_path / name).masses is None


def test_masses_are_as_many_as_joints():
    with pytest.raises(InputError, match="6 joints and needs as many masses"):
        Arm("any", load_arm("ur5").chain, masses=LinkMasses(np.ones(5), np.zeros((5, 3))))


@pytest.mark.parametrize(("mass", "centre"), [(-1, 0), (np.nan, 0), (1, np.inf), (1e6, 0), (1, 1e7)])
def test_masses_no_link_can_have_are_refused(mass, centre):
    refuses("masses", LinkMasses, [mass], [[0, 0, centre]])


# There and back


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["dh", "mdh", "urdf"]))
def test_any_arm_goes_there_and_back(tmp_path_factory, seed, form):
    arm = random_arm(seed)
    path = tmp_path_factory.mktemp("arm") / ("arm.urdf" if form == "urdf" else "arm.toml")
    write_arm(arm, path, **({} if form == "urdf" else {"convention": form}))
    assert_same_arm(arm, read_arm(path))


@pytest.mark.parametrize("convention", ["dh", "mdh"])
@pytest.mark.parametrize("name", [name for name in list_arms() if name != "gen3lite"])
def test_every_arm_of_the_catalogue_goes_there_and_back(tmp_path, name, convention):
    write_arm(load_arm(name), tmp_path / "arm.toml", convention=convention)
    assert_same_arm(load_arm(name), read_arm(tmp_path / "arm.toml"))


def random_arm(seed: int) -> Arm:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 7))
    fixed = np.array([frame_from_xyz_rpy(rng.uniform(-500, 500, 3), rng.uniform(-3, 3, 3)) for _ in range(n + 1)])
    # Axes at least 6 deg off parallel, so that a table exists.
    for frame in fixed:
        if abs(frame[2, 2]) > 0.995:
            frame[:3, :3] = frame_from_xyz_rpy([0, 0, 0], [1.0, 0.2, 0.3])[:3, :3]
    chain = Chain(fixed, rng.uniform(-100, 100, 3), rng.random(n) < 0.3)
    limited = rng.random(n) < 0.5
    lower, upper = np.where(limited, rng.uniform(-3, -1, n), -np.inf), np.where(limited, rng.uniform(1, 3, n), np.inf)
    title = 'quotes " and \\ and \t tab, ä, 测量臂, \x7f, 😀'
    known = rng.random() < 0.5
    return Arm(
        "any",
        chain,
        title=title.replace("\x7f", ""),
        lower=lower,
        upper=upper,
        working_pose=rng.uniform(-1, 1, n),
        masses=LinkMasses(rng.uniform(0.1, 9, n), rng.uniform(-300, 300, (n, 3))) if known else None,
        gravity_in_base=rng.normal(size=3) if known else None,
    )


def assert_same_arm(one: Arm, other: Arm) -> None:
    for name in ("name", "title", "source", "joint_names"):
        assert getattr(one, name) == getattr(other, name)
    np.testing.assert_array_equal(one.chain.is_prismatic, other.chain.is_prismatic)
    # degrees are written to twelve decimals: 1.7e-14 rad
    np.testing.assert_allclose(one.limits, other.limits, rtol=0, atol=2e-14)
    np.testing.assert_allclose(one.working, other.working, rtol=0, atol=2e-14)
    q = np.random.default_rng(0).uniform(-3, 3, (10, one.n_joints)) * np.where(one.chain.is_prismatic, 100, 1)
    np.testing.assert_allclose(one.gravity_direction, other.gravity_direction, rtol=0, atol=1e-15)
    assert (one.masses is None) == (other.masses is None)
    if one.masses is not None and other.masses is not None:
        np.testing.assert_array_equal(one.masses.mass_kg, other.masses.mass_kg)
        # Places may be turned about and shifted along their axes: what the weight does about the axis stays.
        own = [gravity_torques(arm.chain, q, arm.masses, gravity_in_base=arm.gravity_direction) for arm in (one, other)]
        turning = ~one.chain.is_prismatic
        np.testing.assert_allclose(own[0][:, turning, 2], own[1][:, turning, 2], atol=1e-10, rtol=0)  # of up to 50 N m
    first, second = one.chain.pose(q), other.chain.pose(q)
    np.testing.assert_allclose(first.tip_in_base, second.tip_in_base, atol=1e-9, rtol=0)
    np.testing.assert_allclose(first.R_base_tip, second.R_base_tip, atol=1e-12, rtol=0)


def test_text_with_any_sign_survives_and_is_printable(tmp_path):
    title = 'quotes " and \\ and \t tab, \x7f, \x01, ä, 测量臂, 😀\nsecond line'
    arm = Arm("any", load_arm("ur5").chain, title=title)
    write_arm(arm, tmp_path / "arm.toml")
    shown = 'quotes " and \\ and \\t tab, \\x7f, \\x01, ä, 测量臂, 😀\\nsecond line'
    assert read_arm(tmp_path / "arm.toml").title == arm.title == shown


def test_nothing_is_left_of_an_arm_that_has_no_table(tmp_path):
    refuses("URDF", write_arm, load_arm("gen3lite"), tmp_path / "arm.toml")
    assert list(tmp_path.iterdir()) == []


# What it refuses

BROKEN = {
    "syntax": (GOOD + "x ==\n", r"line 25: not valid TOML: .*Try: write dates as 2026-01-15"),
    "key twice": (changed('name = "two"', 'name = "two"\nname = "three"'), "line 3: not valid TOML"),
    "nesting": ("a = " + "[" * 5000, "not valid TOML|nested too deeply"),
    "no name": (changed('name = "two"\n', ""), "the key name is missing"),
    "empty name": (changed('"two"', '""'), "name: expected text that is not empty, got ''"),
    "no convention": (changed('convention = "dh"\n', ""), "the key convention is missing"),
    "convention": (changed('"dh"', '"hayati"'), "convention: expected 'dh' or 'mdh', got 'hayati'"),
    "no joints": ('name = "x"\nconvention = "dh"\n', "the key joints is missing"),
    "empty joints": ('name = "x"\nconvention = "dh"\njoints = []\n', "joints: expected 1 entries or more"),
    "unknown key": (changed("convention", 'colour = "red"\nconvention'), "unknown key colour. Try: use one of name"),
    "unknown unit": (changed("a_mm = 400", "a_inch = 15.7"), r"unknown key joints\[1\].a_inch.* a_mm, a_m,"),
    "no unit": (changed("alpha_deg = 0", "alpha = 0"), r"unknown key joints\[2\].alpha"),
    "two units": (changed("a_mm = 400", "a_mm = 400\na_m = 0.4"), r"joints\[1\]: expected one of a_m and a_mm"),
    "two units of tip": (changed("tip_mm", "tip_m = [0, 0, 1]\ntip_mm"), "expected one of tip_m and tip_mm, got both"),
    "two units of base": (
        GOOD + "[base]\nrpy_deg = [0, 0, 0]\nrpy_rad = [0, 0, 0]",
        "expected one of rpy_deg and rpy_",
    ),
    "missing a": (changed("a_mm = 400\n", ""), r"joints\[1\]: the key a_mm or a_m is missing"),
    "missing alpha": (changed("alpha_deg = 0\n", ""), r"joints\[2\]: the key alpha_deg or alpha_rad is missing"),
    "text": (changed("a_mm = 400", 'a_mm = "400"'), r"joints\[1\].a_mm: expected a number, got '400'. Try: remove"),
    "yes": (changed("a_mm = 400", "a_mm = true"), r"joints\[1\].a_mm: expected a number, got true"),
    "nan": (changed("a_mm = 400", "a_mm = nan"), r"joints\[1\].a_mm: expected a finite number, got nan"),
    "inf": (changed("max_deg = 170", "max_deg = inf"), r"joints\[1\].max_deg: expected a finite number, got inf"),
    "tip of two": (changed("[0, 0, 50]", "[0, 50]"), "tip_mm: expected 3 entries or more"),
    "type": (changed('"revolute"', '"hinge"'), r"joints\[1\].type: expected 'revolute', .* or 'fixed', got 'hinge'"),
    "angle of a slide": (changed("min_mm = -5", "min_deg = -5"), r"joints\[2\]: a prismatic joint needs min_mm or"),
    "length of a hinge": (changed("max_deg = 170", "max_mm = 1"), r"joints\[1\]: a revolute joint needs max_deg or"),
    "limits of a fixed joint": (changed('"revolute"', '"fixed"'), r"joints\[1\]: a fixed joint has no (min|max)_deg"),
    "crossed limits": (changed("min_deg = -170", "min_deg = 175"), "lower limit of J1 must be below"),
    "pose outside": (changed("working_deg = 30", "working_deg = 171"), "working pose of J1 is outside its limits"),
    "one name twice": (changed('"slide"', '"J1"'), "different names"),
    "gravity of two": (changed("convention", "gravity_in_base = [0, -1]\nconvention"), "expected 3 entries or more"),
    "no gravity": (changed("convention", "gravity_in_base = [0, 0, 0]\nconvention"), "gravity as a direction"),
    "mass below zero": (
        changed("a_mm = 400", "a_mm = 400\nmass_kg = -1\ncentre_of_mass_mm = [0, 0, 0]"),
        r"joints\[1\].mass_kg: expected 0 or more",
    ),
    "mass nowhere": (changed("a_mm = 400", "a_mm = 400\nmass_kg = 1"), r"joints\[1\]: mass_kg needs the key centre"),
    "centre of nothing": (
        changed("a_mm = 400", "a_mm = 400\ncentre_of_mass_mm = [0, 0, 0]"),
        r"joints\[1\]: a centre of mass without the key mass_kg",
    ),
    "centre in two units": (
        changed("a_mm = 400", "a_mm = 400\nmass_kg = 1\ncentre_of_mass_mm = [0, 0, 0]\ncentre_of_mass_m = [0, 0, 0]"),
        r"joints\[1\]: expected one of centre_of_mass_m and centre_of_mass_mm, got both",
    ),
    "mass of one": (
        changed("a_mm = 400", "a_mm = 400\nmass_kg = 1\ncentre_of_mass_mm = [0, 0, 0]"),
        "mass of the link after moving joint 2 is missing: expected masses of all 2 links or none, got 1",
    ),
    "mass in grams": (
        changed("a_mm = 400", "a_mm = 400\nmass_kg = 1e9\ncentre_of_mass_mm = [0, 0, 0]").replace(
            "a_mm = 0", "a_mm = 0\nmass_kg = 0"
        ),
        "at most 100000 kg",
    ),
    "only fixed": (
        'name = "x"\nconvention = "dh"\n[[joints]]\ntype = "fixed"\na_mm = 0\nd_mm = 0\nalpha_deg = 0\n',
        "at least one joint that moves",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_file_is_refused_with_its_name_and_the_key(tmp_path, case):
    text, message = BROKEN[case]
    path = write(tmp_path, text)
    assert refuses(message, read_arm, path).file == path


def test_other_files_are_refused(tmp_path):
    refuses("does not exist", read_arm, tmp_path / "none.toml")
    refuses(r"ends in .toml, .urdf, .xml or .yaml, got '.dae'", read_arm, tmp_path / "arm.dae")
    refuses(r"ends in .toml or .urdf, got '.csv'", write_arm, load_arm("ur5"), tmp_path / "arm.csv")
    (tmp_path / "latin.toml").write_bytes(b'name = "x"\ntitle = "\xe4"\n')
    refuses("line 2: expected UTF-8", read_arm, tmp_path / "latin.toml")
    (tmp_path / "big.toml").write_bytes(b"#" * 1_000_001)
    refuses("larger than 1 MB", read_arm, tmp_path / "big.toml")
    refuses("does not exist", write_arm, load_arm("ur5"), tmp_path / "none" / "arm.toml")


@pytest.mark.parametrize(("value", "message"), [("9" * 5000, "not valid TOML"), ("1e30", "check their units")])
def test_absurd_numbers_are_refused(tmp_path, value, message):
    refuses(message, read_arm, write(tmp_path, changed("a_mm = 400", f"a_mm = {value}")))


def test_angles_of_a_frame_are_written_without_rounding(tmp_path):
    """What a composition of rotations leaves, such as -8.3e-32 deg, is no angle."""
    text = GOOD + "[base]\nxyz_mm = [1, 2, 3]\nrpy_deg = [0, 0, -8.3e-32]\n"
    write_arm(read_arm(write(tmp_path, text)), tmp_path / "new.toml")
    assert "rpy_deg = [0.0, 0.0, 0.0]" in (tmp_path / "new.toml").read_text("utf-8")
