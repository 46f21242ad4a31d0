"""Laws of the virtual arm: each class of error does what its formula says, and noise stays apart from the arm."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from refusals import refuses
from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.identification.terms.links import link_temperatures
from truearm.wings.planning.virtual import PRESETS, Preset, VirtualArm, load_preset, magnitudes
from truearm.wings.planning.virtual.error_model import beam, eccentric_reading
from truearm.wings.planning.virtual.presets import ARCSEC
from truearm.wings.planning.virtual.state import hand_forces, mean_hand_force

WORKING_DEG = (0, -60, 0, 60, 0, 60)


def paper_arm() -> Arm:
    """The arm of Gao et al. 2017, table 1."""
    rows = zip([0, 62, 0, 62, 0, 0], [376, 0, 751, 0, 500, 15], [-90, -90, -90, -90, -90, 90], strict=True)
    fixed = np.tile(np.eye(4), (7, 1, 1))
    for i, (a, d, alpha) in enumerate(rows, start=1):
        fixed[i, :3, :3] = Rotation.from_euler("x", alpha, degrees=True).as_matrix()
        fixed[i, :3, 3] = a, 0, d
    return Arm("paper", Chain(fixed, [0, 0, 98]), working_pose=np.radians(WORKING_DEG))


def one_hinge(length_mm: float = 1000.0) -> Arm:
    """A single upright joint with its tip `length_mm` away along x: a rotation r moves the tip by r times that."""
    return Arm("hinge", Chain(np.tile(np.eye(4), (2, 1, 1)), [length_mm, 0, 0]))


def box(arm: Arm, n: int, seed: int) -> np.ndarray:
    return arm.working + np.random.default_rng(seed).uniform(-1, 1, (n, arm.n_joints)) * np.radians(20)


@pytest.fixture(scope="module")
def research() -> VirtualArm:
    return VirtualArm.draw(paper_arm(), PRESETS["research"], seed=3)


# --- laws of the whole ---


def test_a_perfect_arm_is_its_drawing():
    arm = VirtualArm.draw(paper_arm(), Preset(), seed=1)
    angles = box(arm.nominal, 50, 0)
    taken = arm.measure(angles, seed=2)
    assert (taken.readings.angles == angles).all()
    # Composing motions of zero adds exact zeros.
    assert (taken.readings.points == arm.nominal.chain.tip_in_base(angles)).all()


def test_the_same_arm_measured_twice_has_the_same_errors_and_other_noise(research):
    angles = box(research.nominal, 40, 0)
    first, second = research.measure(angles, seed=1), research.measure(angles, seed=2)
    assert (research.motions(angles) == research.motions(angles)).all()
    assert not np.isclose(first.readings.angles, second.readings.angles, rtol=0, atol=0).all()
    # What differs between sessions at the true angles is force, temperature and the cages' start: some um.
    assert np.abs(first.true_tips - second.true_tips).max() < 0.05


def test_the_same_seed_gives_the_same_readings(research):
    angles = box(research.nominal, 40, 0)
    first, second = research.measure(angles, seed=1), research.measure(angles, seed=1)
    assert (first.readings.angles == second.readings.angles).all()
    assert (first.readings.points == second.readings.points).all()


def test_another_seed_gives_another_arm():
    angles = box(paper_arm(), 5, 0)
    tips = [VirtualArm.draw(paper_arm(), PRESETS["shop"], seed=seed).true_tip(angles) for seed in (0, 1)]
    assert np.abs(tips[0] - tips[1]).max() > 0.005


def test_an_arm_and_a_session_of_one_seed_share_no_randomness():
    # The arm's lag and the session's air come from streams of like names: their draws must differ.
    arm = VirtualArm.draw(paper_arm(), Preset(cage_tilt_std_arcsec=1.0), seed=5)
    columns = arm.state(box(arm.nominal, 3, 0), seed=5).columns
    phase = [columns[f"cage_phase_{joint}_rad"][0] for joint in range(1, 7)]
    tilt = arm.systematic.of_group("ball cages").reshape(6, 2, 2)[:, 0, 0]
    assert np.abs(np.corrcoef(tilt, phase)[0, 1]) < 0.999


def test_changing_one_class_leaves_the_draws_of_the_others():
    shop = PRESETS["shop"]
    plain = VirtualArm.draw(paper_arm(), shop, seed=0).systematic
    other = VirtualArm.draw(
        paper_arm(), replace(shop, bearing_tilt_std_arcsec=9.0, length_std_mm=1.0), seed=0
    ).systematic
    for group in ("encoders", "compliance", "thermal expansion", "hysteresis", "ball cages"):
        assert (plain.of_group(group) == other.of_group(group)).all(), group
    assert (plain.lag_s == other.lag_s).all()
    assert not (plain.of_group("bearings") == other.of_group("bearings")).all()


def test_noise_magnitudes_do_not_move_each_others_draws(research):
    angles = box(research.nominal, 30, 0)
    silent = replace(research, preset=replace(research.preset, encoder_noise_arcsec=0.0))
    plain, other = research.measure(angles, seed=1), silent.measure(angles, seed=1)
    assert (plain.readings.points == other.readings.points).all()


def test_composition_is_exact():
    """Against a chain built anew for every pose as a product of 4 x 4 matrices with the motions put in."""
    arm = VirtualArm.draw(paper_arm(), PRESETS["research"], seed=0)
    angles = box(arm.nominal, 4, 1)
    state = arm.state(angles, seed=1)
    chain = arm.nominal.chain
    for row, motion in enumerate(arm.motions(angles, state)):
        T = chain.fixed[0] @ matrix(motion[0])
        for i in range(1, 7):
            turn = np.eye(4)
            turn[:3, :3] = Rotation.from_rotvec([0, 0, angles[row, i - 1]]).as_matrix()
            T = T @ turn @ matrix(motion[i]) @ chain.fixed[i]
        tip = T[:3, :3] @ (chain.tip_in_flange + motion[-1, 3:]) + T[:3, 3]
        # A dozen products of lengths of 1e3 mm: rounding is 1e-12.
        assert arm.true_tip(angles, state)[row] == pytest.approx(tip, abs=1e-10)


def matrix(motion: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(motion[:3]).as_matrix()
    T[:3, 3] = motion[3:]
    return T


# --- each class alone ---


def test_eccentricity_reads_412_5_e_over_D_arcsec():
    # Published examples: 10 um on 100 mm give 41 arcsec, on 50 mm 83 arcsec (printed to whole seconds).
    arcsec = eccentric_reading([10.0], diameter_mm=100.0) / ARCSEC
    assert arcsec == pytest.approx([41.25], abs=0.01)
    assert eccentric_reading(10.0, diameter_mm=50.0) / ARCSEC == pytest.approx(82.5, abs=0.02)


def test_encoder_turns_the_joint_by_its_harmonics():
    preset = Preset(
        eccentricity_std_um=5.0, grating_diameter_mm=50.0, encoder_order2_std_arcsec=2.0, encoder_order4_std_arcsec=1.0
    )
    arm = VirtualArm.draw(one_hinge(), preset, seed=0)
    q = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    tips = arm.true_tip(q[:, None])
    error = np.angle((tips[:, 0] + 1j * tips[:, 1]) * np.exp(-1j * q))
    spectrum = np.fft.rfft(error) / 32
    assert np.flatnonzero(np.abs(spectrum) > 1e-12).tolist() == [1, 2, 4]
    coefficients = arm.systematic.of_group("encoders").reshape(3, 2)
    assert spectrum[[1, 2, 4]].real == pytest.approx(coefficients[:, 0], abs=1e-14)
    assert -spectrum[[1, 2, 4]].imag == pytest.approx(coefficients[:, 1], abs=1e-14)


def test_encoder_magnitudes_are_those_of_the_preset():
    preset = Preset(
        eccentricity_std_um=5.0, grating_diameter_mm=50.0, encoder_order2_std_arcsec=2.0, encoder_order4_std_arcsec=1.0
    )
    drawn = np.array(
        [VirtualArm.draw(one_hinge(), preset, seed=s).systematic.of_group("encoders").reshape(3, 2) for s in range(400)]
    )
    # 800 draws: their standard deviation is known to 2.5 %; 3.5 sigma.
    assert drawn.std(axis=(0, 2)) / ARCSEC == pytest.approx([412.5 * 5 / 50, 2.0, 1.0], rel=0.09)


def test_bearing_moves_all_axes_but_its_own():
    arm = VirtualArm.draw(one_hinge(), Preset(bearing_runout_std_um=3.0, bearing_tilt_std_arcsec=5.0), seed=0)
    q = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    motions = arm.motions(q[:, None])[:, 1]
    spectrum = np.abs(np.fft.rfft(motions, axis=0)) / 32
    assert (spectrum[:, 2] == 0).all()
    others = [0, 1, 3, 4, 5]
    assert (spectrum[1:3, others] > 1e-9).all()
    assert np.abs(np.delete(spectrum[:, others], [1, 2], axis=0)).max() < 1e-15


def test_a_soft_bearing_tilts_by_torque_and_compliance():
    # A hinge lying along the base's y with 1 m of 2 kg along x: its torque is about its own axis, and tilts nothing.
    lying = np.eye(4)
    lying[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    arm = Arm("lying", Chain(np.stack([lying, np.eye(4)]), [1000, 0, 0]))
    soft = VirtualArm.draw(arm, Preset(link_kg_per_m=2.0, joint_tilt_arcsec_per_Nm=2.0), seed=0)
    assert np.abs(soft.motions([[0.0]])).max() < 1e-15
    # An upright joint carries the same torque, 9.80665 N m, across its axis.
    soft = VirtualArm.draw(one_hinge(), Preset(link_kg_per_m=2.0, joint_tilt_arcsec_per_Nm=2.0), seed=0)
    sag = soft.true_tip([[0.7]])[0, 2]
    assert sag == pytest.approx(-2.0 * 9.80665 * ARCSEC * 1000, rel=1e-6)


def test_a_horizontal_tube_sags_as_a_cantilever():
    # w L^4 / (8 E I) = 2 kg/m * 9.80665 * 1 m^4 / (8 * 1000 N m^2) = 2.45 mm, whichever way it points.
    preset = Preset(link_kg_per_m=2.0, link_bending_stiffness_Nm2=1000.0)
    arm = VirtualArm.draw(one_hinge(), preset, seed=0)
    shift = arm.true_tip([[0.0], [2.0]]) - arm.nominal.chain.tip_in_base([[0.0], [2.0]])
    # The motion is composed exactly, its tip is linear in it to slope^2/2 = 5e-6.
    assert shift[:, 2] == pytest.approx([-2.0 * 9.80665 / 8000 * 1000] * 2, rel=1e-5)


def test_a_loaded_tube_bends_and_slopes_as_the_textbook_says():
    # Tip load F: F L^3 / 3EI and F L^2 / 2EI. At the held end: moment F L about -y for F along -z and L along x... here
    # L = 0.65 m, F = 20 N, E I = 15.3e3 N m^2: 0.120 mm and 57 arcsec.
    L, F, EI = 650.0, 20.0, 15.3e3
    torque = np.cross([L * 1e-3, 0, 0], [0, 0, -F])
    motion = beam(np.array([L, 0, 0]), own_share=0.0, bending_stiffness_Nm2=EI, torsion_stiffness_Nm2=np.inf) @ [
        *torque,
        0,
        0,
        -F,
    ]
    slope = F * (L * 1e-3) ** 2 / (2 * EI)
    assert motion[:3] == pytest.approx([0, slope, 0], abs=1e-18)
    end = motion[3:] + np.cross(motion[:3], [L, 0, 0])
    assert end == pytest.approx([0, 0, -F * (L * 1e-3) ** 3 / (3 * EI) * 1e3], abs=1e-15)
    assert slope / ARCSEC == pytest.approx(57, abs=0.5)
    assert end[2] == pytest.approx(-0.12, abs=0.005)


def test_a_tube_of_own_weight_slopes_by_a_sixth():
    L, w, EI = 1.3, 4.0, 500.0  # m, N/m, N m^2; slope w L^3 / 6EI
    load = [*np.cross([L / 2, 0, 0], [0, 0, -w * L]), 0, 0, -w * L]
    motion = (
        beam(np.array([L * 1e3, 0, 0]), own_share=1.0, bending_stiffness_Nm2=EI, torsion_stiffness_Nm2=np.inf) @ load
    )
    assert motion[1] == pytest.approx(w * L**3 / (6 * EI), rel=1e-12)


def test_a_tube_twists_by_torque_along_it():
    twist = beam(np.array([0, 0, 650.0]), own_share=0.0, bending_stiffness_Nm2=np.inf, torsion_stiffness_Nm2=1.08e4)
    motion = twist @ [0, 0, 0.3, 0, 0, 0]
    assert motion[2] / ARCSEC == pytest.approx(3.7, abs=0.05)
    assert np.abs(np.delete(motion, 2)).max() == 0


def test_links_grow_with_temperature():
    arm = VirtualArm.draw(one_hinge(), Preset(expansion_per_K=23e-6), seed=0)
    taken = arm.measure([[0.0], [0.0]], seed=0, temperature_degC=[25.0, 25.0])
    # 1 m of aluminium, 5 K: 0.115 mm; no lag, so at once.
    assert taken.true_tips[:, 0] == pytest.approx([1000.115] * 2, abs=1e-9)
    assert taken.readings.temperature_degC == pytest.approx([25, 25])


def test_a_lag_follows_a_step_of_the_air_to_63_per_cent_in_its_time_constant():
    air = np.array([20.0] + [30.0] * 100)
    links = link_temperatures(air, [50.0, 0.0], interval_s=0.5)
    assert links[100, 0] == pytest.approx(20 + 10 * (1 - np.exp(-1)), abs=1e-9)
    assert (links[:, 1] == air).all()


def test_the_measuring_force_pushes_the_tip_back_along_the_stylus():
    arm = VirtualArm.draw(one_hinge(), Preset(tip_compliance_um_per_N=5.0, force_mean_N=2.0), seed=0)
    assert arm.true_tip([[0.0]])[0] == pytest.approx([1000, 0, -0.010], abs=1e-9)


def test_the_mean_force_is_the_mean_of_the_drawn_forces():
    preset = Preset(force_mean_N=2.0, force_std_N=0.3, force_tilt_deg=25.0)
    forces = hand_forces(preset, 200_000, np.random.default_rng(0))
    # Scatter 0.9 N across 200 000 draws: 0.002 N; 4 sigma.
    assert forces.mean(axis=0) == pytest.approx(mean_hand_force(preset), abs=0.008)


def test_encoders_read_whole_counts():
    arm = VirtualArm.draw(paper_arm(), Preset(encoder_counts=2**14), seed=0)
    angles = box(arm.nominal, 500, 0)
    counts = arm.measure(angles, seed=0).readings.angles * 2**14 / (2 * np.pi)
    assert counts == pytest.approx(np.round(counts), abs=1e-9)
    error = arm.measure(angles, seed=0).readings.angles - angles
    # 79 arcsec a step, 23 arcsec standard deviation (step / sqrt 12); 3000 values give it to 1.3 %.
    assert error.std() / ARCSEC == pytest.approx(1_296_000 / 2**14 / np.sqrt(12), rel=0.05)


def test_encoder_noise_and_reference_noise_have_their_size():
    arm = VirtualArm.draw(paper_arm(), Preset(encoder_noise_arcsec=2.0, reference_std_mm=0.004), seed=0)
    taken = arm.measure(box(arm.nominal, 2000, 0), seed=0)
    assert (taken.readings.angles - taken.true_angles).std() / ARCSEC == pytest.approx(2.0, rel=0.04)
    assert (taken.readings.points - taken.true_tips).std() == pytest.approx(0.004, rel=0.04)
    assert (taken.readings.point_std == 0.004).all()


def test_hysteresis_separates_the_two_directions_by_twice_its_size():
    arm = VirtualArm.draw(one_hinge(), Preset(hysteresis_std_arcsec=1.0), seed=0)
    tips = arm.measure([[-0.1], [0.0], [0.1], [0.0]], seed=0).true_tips
    gap = tips[1, 1] - tips[3, 1]
    assert gap == pytest.approx(2 * arm.systematic.of_group("hysteresis")[0] * 1000, rel=1e-6)
    assert gap != 0


def test_a_ball_cage_repeats_after_five_turns_of_the_joint_and_not_after_one():
    arm = VirtualArm.draw(one_hinge(), Preset(cage_tilt_std_arcsec=5.0, cage_runout_std_um=2.0), seed=0)
    turns = np.array([[0.3], [0.3 + 2 * np.pi], [0.3 + 10 * np.pi]])
    tips = arm.true_tip(turns)
    assert tips[2] == pytest.approx(tips[0], abs=1e-9)
    assert np.abs(tips[1] - tips[0]).max() > 1e-4


# --- the noise floor, the presets ---


def test_without_noise_the_floor_is_zero():
    shop = replace(
        PRESETS["shop"],
        encoder_counts=0,
        encoder_noise_arcsec=0.0,
        reference_std_mm=0.0,
        force_std_N=0.0,
        force_tilt_deg=0.0,
    )
    arm = VirtualArm.draw(paper_arm(), shop, seed=0)
    taken = arm.measure(box(arm.nominal, 100, 0), seed=0)
    assert taken.readings.point_std is None
    assert arm.noise_floor(taken)["max_mm"] < 1e-12


def test_pure_reference_noise_is_the_floor():
    arm = VirtualArm.draw(paper_arm(), Preset(reference_std_mm=0.01), seed=0)
    floor = arm.noise_floor(arm.measure(box(arm.nominal, 5000, 0), seed=0))
    assert floor["mean_abs_coordinate_mm"] == pytest.approx(0.01 * np.sqrt(2 / np.pi), rel=0.02)
    assert floor["rms_mm"] == pytest.approx(0.01 * np.sqrt(3), rel=0.02)


def test_every_magnitude_has_a_unit_and_a_source():
    named = {m.name for m in magnitudes(Preset())}
    assert named == {f.name for f in fields(Preset)} - {"name", "about"}
    for magnitude in magnitudes(PRESETS["research"]):
        assert magnitude.unit
        assert magnitude.source


def test_a_session_in_seats_has_its_tips_there_but_for_the_seats_scatter(research):
    angles = box(research.nominal, 200, 0)
    seats = research.nominal.chain.tip_in_base(angles)
    taken = research.measure(angles, seed=1, seat=["A"] * 200, seat_points=seats)
    off = taken.true_tips - seats
    assert off.std() == pytest.approx(research.preset.seat_std_mm, rel=0.15)
    firm = replace(research, preset=replace(research.preset, seat_std_mm=0.0))
    assert np.abs(firm.measure(angles, seed=1, seat_points=seats).true_tips - seats).max() < 1e-6
    assert taken.readings.seat.tolist() == ["A"] * 200


def test_a_seat_out_of_reach_is_refused(research):
    refuses(r"pose 1 does not reach its seat.*mm away", research.settle, [research.nominal.working], [[9000.0, 0, 0]])


# --- what is refused ---


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda a: a.measure(np.zeros((3, 5)), seed=0), r"\(n, 6\)"),
        (lambda a: a.measure(np.zeros((0, 6)), seed=0), "at least one pose"),
        (lambda a: a.measure(np.full((3, 6), np.nan), seed=0), "finite angles"),
        (lambda a: a.measure(np.zeros((3, 6)), seed=-1), "seed"),
        (lambda a: a.measure(np.zeros((3, 6)), seed=0, temperature_degC=[20, 21]), "one temperature or 3"),
        (lambda a: a.true_tip(np.zeros((3, 6)), a.resting(np.zeros((2, 6)))), "state of 3 readings"),
        (lambda a: a.settle(np.zeros((3, 6)), np.zeros((2, 3))), "a seat's point for each of 3"),
        (lambda a: a.noise_floor(a.measure(np.zeros((3, 6)), seed=0, reference=False)), "needs reference points"),
        (lambda a: VirtualArm.draw(a.nominal, a.preset, seed=-3), "seed"),
        (lambda a: load_preset("laboratory"), "perfect, research, shop, worn"),
        (lambda a: Preset(encoder_noise_arcsec=-1.0), r"encoder_noise_arcsec must be a number >= 0 \[arcsec\]"),
        (lambda a: Preset(reference_std_mm=float("nan")), "reference_std_mm"),
        (lambda a: Preset(link_bending_stiffness_Nm2=0.0), "link_bending_stiffness_Nm2"),
        (lambda a: Preset(nominal_mean_mm=0.4, length_std_mm=1.0), "needs a larger nominal_max_mm"),
        (lambda a: Preset(nominal_mean_mm=0.4, nominal_max_mm=0.8), "needs errors of the geometry"),
        (lambda a: VirtualArm.draw(a.nominal, replace(a.preset, nominal_max_mm=40.0), seed=0), "none of 20000 draws"),
    ],
)
def test_what_does_not_fit_is_refused(research, call, says):
    refuses(says, call, research)


# --- sliding joints ---


def scara() -> Arm:
    """Two parallel hinges, a slide of 200 mm and a hinge."""
    fixed = np.tile(np.eye(4), (5, 1, 1))
    fixed[1, 0, 3], fixed[2, 0, 3] = 325, 275
    fixed[2, :3, :3] = np.diag([1.0, -1, -1])
    lower, upper = np.array([-2.0, -2, 0, -3]), np.array([2.0, 2, 200, 3])
    slides = np.array([False, False, True, False])
    chain = Chain(fixed, [40, 0, 60], slides)
    return Arm("scara", chain, lower=lower, upper=upper, working_pose=np.array([0.0, 1, 100, 0]))


def test_a_slide_errs_along_its_travel_and_has_no_error_of_a_turn():
    preset = replace(PRESETS["worn"], bearing_tilt_std_arcsec=5.0, hysteresis_std_arcsec=10.0)
    virtual = VirtualArm.draw(scara(), preset, seed=1)
    names = [term.name for term in virtual.perturbed_chain.terms if term.name.startswith("J3")]
    assert {"J3 roll by travel", "J3 straightness along x by travel", "J3 positioning by travel"} <= set(names)
    assert not [name for name in names if any(word in name for word in ("wobble", "encoder", "spot", "gear", "slack"))]
    assert not [term for term in virtual.perturbed_chain.terms if "J2 cable" in term.name or "J3 cable" in term.name]
    (hysteresis,) = [term for term in virtual.perturbed_chain.terms if term.name == "J3 hysteresis"]
    assert hysteresis.prior_std == pytest.approx(10 * ARCSEC * virtual.nominal.chain.reach / 3)  # mm
    assert hysteresis.direction == (0, 0, 0, 0, 0, 1)


def test_an_arm_with_a_slide_is_measured_in_mm_and_settles_in_seats():
    virtual = VirtualArm.draw(scara(), PRESETS["research"], seed=1)
    angles = virtual.nominal.working + np.random.default_rng(0).uniform(-1, 1, (20, 4)) * [0.3, 0.3, 80, 1]
    measured = virtual.measure(angles, seed=2)
    assert measured.readings.angle_columns == ("q1_deg", "q2_deg", "q3_mm", "q4_deg")
    step = 2 * np.pi / virtual.preset.encoder_counts * np.array([1, 1, virtual.nominal.chain.reach / 3, 1])
    np.testing.assert_allclose(np.remainder(measured.readings.angles / step + 0.5, 1), 0.5, atol=1e-6)
    seats = virtual.true_tip(angles) + [0.5, -0.4, 0.3]
    settled = virtual.settle(angles, seats)
    np.testing.assert_allclose(virtual.true_tip(settled), seats, atol=1e-6)
    assert np.abs(settled - angles)[:, 2].max() < 1.0  # mm


def test_an_arm_that_bends_more_than_the_preset_states_keeps_its_geometry_as_drawn(research):
    strict = replace(research.preset, nominal_mean_mm=0.01)
    drawn = VirtualArm.draw(research.nominal, strict, seed=0)
    free = VirtualArm.draw(research.nominal, replace(strict, nominal_mean_mm=0.0, nominal_max_mm=0.0), seed=0)
    assert (drawn.systematic.geometry == free.systematic.geometry).all()
