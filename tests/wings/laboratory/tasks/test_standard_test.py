"""A standard's test taken by virtual arms: poses that touch its points, and results that follow from the errors."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from refusals import refuses
from truearm.arm.catalogue import load_arm
from truearm.errors import InputError
from truearm.wings.laboratory.standards.artefacts import Artefacts, example_artefacts
from truearm.wings.laboratory.standards.decision import Verdict
from truearm.wings.laboratory.standards.layout import lay_out_tests
from truearm.wings.laboratory.standards.measurands import LengthMeasurement, SphereMeasurement
from truearm.wings.laboratory.standards.measured_points import read_points
from truearm.wings.laboratory.standards.specification import example_specification
from truearm.wings.laboratory.standards.verification import verify
from truearm.wings.laboratory.standards.verification_plan import load_verification_plan
from truearm.wings.laboratory.tasks.posed_test import pose
from truearm.wings.laboratory.tasks.sampled_arms import PresetDistribution
from truearm.wings.laboratory.tasks.simulated_verification import (
    proportion_interval,
    result_distributions,
    simulate_points,
    simulate_verification,
    verdict_shares,
)
from truearm.wings.planning.designs.sampling import inner_limits
from truearm.wings.planning.virtual import load_preset

RANGE = 2500.0
ARM = load_arm("measuring7")


@cache
def posed(name="iso10360-12"):
    return pose(
        lay_out_tests(load_verification_plan(name), example_artefacts(RANGE), RANGE, shoulder_mm=320.0), ARM, seed=0
    )


def exact():
    """The example artefacts, as good as certificates allow."""
    whole = example_artefacts(RANGE)
    nothing = {"form_mm": 0.0, "u_fixture_mm": 0.0}
    still = {**nothing, "u_temperature_K": 0.0}
    bar = whole.bars[0]
    return Artefacts(
        spheres=tuple(one.model_copy(update={**still, "u_diameter_mm": 1e-12}) for one in whole.spheres),
        bars=(
            bar.model_copy(
                update={**still, "lengths": tuple(one.model_copy(update={"u_mm": 1e-12}) for one in bar.lengths)}
            ),
        ),
        seats=tuple(one.model_copy(update=nothing) for one in whole.seats),
    )


@dataclass(frozen=True)
class MadeUp:
    """Arms that err as told: the same function of the tip for all, and noise."""

    at: object = None
    noise_mm: float = 0.0
    arm = ARM

    def draw(self, seed):
        return self

    def systematic(self, angles):
        return np.zeros((len(angles), 3)) if self.at is None else self.at(self.arm.chain.tip_in_base(angles))

    def random(self, angles, rng):
        return self.noise_mm * rng.standard_normal((len(angles), 3))


def taken(errors, *, n_arms=1, name="iso10360-12", artefacts=None, seed=0):
    return simulate_verification(
        errors,
        posed(name),
        plan=load_verification_plan(name),
        artefacts=artefacts or exact(),
        specification=example_specification(RANGE),
        n_arms=n_arms,
        seed=seed,
    )


def values(found):
    return {row.label: row.value for row in found.rows}


# Poses ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["iso10360-12", "asme-b89.4.22"])
def test_the_nominal_tip_is_on_every_point_off_the_end_stops(name):
    test = posed(name)
    assert test.angles.shape == (len(test.points), 7)
    assert ARM.chain.tip_in_base(test.angles) == pytest.approx(test.points, abs=1e-5)
    lower, upper = inner_limits(ARM)
    assert ((test.angles >= lower) & (test.angles <= upper)).all()
    sizes = np.bincount(test.placement)
    assert sizes.tolist() == [len(one.points) for one in test.placements]


def test_the_stylus_comes_from_where_it_is_wanted():
    """Nearly everywhere to rounding, and nowhere more than 60 deg off."""
    test = posed()
    stylus = ARM.chain.tip_derivatives(test.angles).motion_jacobian[:, -1, 5]  # a shift along the flange's z
    approach = np.concatenate([one.approach for one in test.placements])
    off = np.degrees(np.arccos(np.clip(-(stylus * approach).sum(axis=1), -1, 1)))
    assert (off < 0.01).mean() > 0.9
    assert off.max() <= 60.01


def test_groups_are_taken_in_postures_of_their_own():
    """In a group the joints move little from point to point; from group to group much; in a seat as much as can be."""
    test = posed()
    groups = [i for i, one in enumerate(test.placements) if one.test == "articulation"]
    within = [np.ptp(test.angles[test.placement == i], axis=0).max() for i in groups]
    means = np.stack([test.angles[test.placement == i].mean(axis=0) for i in groups[:5]])
    assert max(within) < np.radians(60)
    assert np.ptp(means, axis=0).max() > np.radians(60)
    seats = posed("asme-b89.4.22")
    for i, one in enumerate(seats.placements):
        if one.test == "single_point":
            assert np.ptp(seats.angles[seats.placement == i], axis=0).max() > np.radians(90)


def test_poses_are_those_of_the_seed():
    layout = lay_out_tests(load_verification_plan("iso10360-12"), example_artefacts(RANGE), RANGE)[:2]
    assert (pose(layout, ARM, seed=1).angles == pose(layout, ARM, seed=1).angles).all()
    assert (pose(layout, ARM, seed=1).angles != pose(layout, ARM, seed=2).angles).any()


def test_what_is_not_reached_is_named():
    far = lay_out_tests(load_verification_plan("iso10360-12"), example_artefacts(4000.0), 4000.0)
    refused = refuses(None, pose, far, ARM, seed=0)
    links = "beyond the arm's links"
    beyond = sum(np.linalg.norm(one.points - [0, 0, 320], axis=1).max() > 1290 for one in far if one.test == "uni")
    assert refused.problem.endswith(
        f"does not reach {50 + beyond} of 310 points: probing, position 2: {links} (25 x); "
        f"articulation, position 2: {links} (25 x); uni, all 7 positions: {links} ({beyond} x)"
    )
    assert "1291 mm" in refused.hint
    assert "a plan of your own (truearm verify plan) without these places" in refused.hint
    # Within the length of the links, but stretched out to the last and touched from beyond.
    stretched = next(one for one in far if one.test == "uni")
    out = np.array([1.0, 0.0, 0.0])
    beyond = replace(
        stretched, points=np.array([[1280.0, 0.0, 320.0]]), at=np.array([1280.0, 0.0, 320.0]), approach=out[None]
    )
    refuses(r"does not reach 1 of 1 points: uni, .*: target", pose, [beyond], ARM, seed=0)
    seat = next(one for one in far if one.test == "probing")
    seat = replace(seat, test="single_point", at=seat.at * 0.01, points=seat.points[:2] * 0.01)
    with pytest.raises(InputError, match="does not reach 2 of 3 points: single_point, position 1: too few postures"):
        pose([seat, replace(stretched, points=np.array([[700.0, 0.0, 320.0]]), approach=-out[None])], ARM, seed=0)


def test_lengths_and_groups_are_named_where_others_of_them_are_reached():
    layout = [one for one in posed().placements if one.test != "probing"]
    far = {("length", "1700"), ("group", "C")}
    away = [replace(one, points=one.points + [3000.0, 0, 0]) if far & set(one.keys.items()) else one for one in layout]
    refused = refuses(None, pose, away, ARM, seed=0)
    assert refused.problem.endswith(
        "articulation, all 2 positions, group C: beyond the arm's links (10 x); "
        "uni, all 7 positions, length 1700: beyond the arm's links (42 x)"
    )


# Errors --------------------------------------------------------------------------------------------------------------


def test_a_perfect_arm_on_exact_artefacts_shows_nothing():
    for name in ("iso10360-12", "asme-b89.4.22"):
        (found,) = taken(MadeUp(), name=name)
        assert max(abs(value) for value in values(found).values()) < 1e-6
        assert found.verdict is Verdict.CONFORM


def test_an_error_of_scale_comes_out_in_lengths():
    """50 um per metre: 85 um in 1.7 m; on a ball of 25 mm 1.25 um, of form and place nothing."""
    (found,) = taken(MadeUp(lambda tips: 50e-6 * tips))
    shown = values(found)
    assert shown["E_Uni, 1700"] == pytest.approx(0.085, abs=1e-6)
    assert shown["E_Uni, 150"] == pytest.approx(0.0075, abs=1e-6)
    assert shown["P_Size.Sph.1x25"] == pytest.approx(0.00125, abs=1e-6)
    assert abs(shown["P_Form.Sph.1x25"]) < 1e-6
    assert abs(shown["L_Dia.5x5"]) < 1e-6
    assert found.verdict is Verdict.NOT_CONFORM


def test_a_shift_of_everything_is_no_error():
    (found,) = taken(MadeUp(lambda tips: np.tile([0.3, -0.2, 0.1], (len(tips), 1))))
    assert max(abs(value) for value in values(found).values()) < 1e-6


def test_noise_has_the_size_that_statistics_give():
    """White noise s of a coordinate: a length errs by s sqrt 2, a seat's 2s is 2 sqrt(3) s."""
    s = 0.01
    found = taken(MadeUp(noise_mm=s), n_arms=40, name="asme-b89.4.22")
    rows = [values(one) for one in found]
    assert np.mean([row["Volumetric.2RMS"] for row in rows]) == pytest.approx(2 * np.sqrt(2) * s, rel=0.05)
    seats = [[row.value for row in one.rows if row.label == "SPAT.2s"] for one in found]
    assert np.sqrt(np.mean(np.square(seats))) == pytest.approx(2 * np.sqrt(3) * s, rel=0.05)


def test_errors_of_artefacts_are_drawn_within_their_certificates():
    """A perfect arm finds each size and length as its certificate says, but for the budget that `verify` gives it."""
    whole = example_artefacts(RANGE)
    ball, bar = whole.spheres[0], whole.bars[0]
    rough = Artefacts(
        spheres=(ball.model_copy(update={"form_mm": 0.0, "u_diameter_mm": 0.01, "u_fixture_mm": 0.0}),),
        bars=(bar.model_copy(update={"form_mm": 0.0}),),
        seats=whole.seats,
    )
    sizes, lengths = [], []
    for seed in range(100):
        shown = simulate_points(MadeUp(), posed(), rough, seed=seed).tests
        sizes.append(SphereMeasurement(rough.spheres[0], shown["probing"][0].points).size_error(corrected=True))
        ends = [one for one in shown["uni"] if one.keys["length"] == "1700"][:2]
        long = LengthMeasurement(rough.bars[0], bar.length("1700"), ends[0].points, ends[1].points)
        lengths.append(long.error(corrected=True))
    # The standard deviation of 100 draws is known to 7 %.
    assert np.std(sizes) == pytest.approx(0.01, rel=0.25)
    assert np.std(lengths) == pytest.approx(long.budget(corrected=True).u, rel=0.25)
    assert np.std(lengths) > 0.0025


@pytest.mark.parametrize("name", ["iso10360-12", "asme-b89.4.22"])
def test_points_in_a_file_are_judged_as_those_in_memory(tmp_path, name):
    """What a technician's program would write of the same points: the same rows, to the digits of the file."""
    errors, artefacts = PresetDistribution(ARM, load_preset("shop")), example_artefacts(RANGE)
    shown = simulate_points(errors.draw(3), posed(name), artefacts, seed=3)
    lines = ["test,artefact,date,position,length,repeat,end,group,x_mm,y_mm,z_mm,artefact_degC"]
    for test, groups in shown.tests.items():
        for group in groups:
            told = ",".join(group.keys.get(key, "") for key in ("position", "length", "repeat", "end", "group"))
            for x, y, z in group.points:
                lines.append(f"{test},{group.artefact},{group.date},{told},{x:.9f},{y:.9f},{z:.9f},{group.degC}")
    path = tmp_path / "points.csv"
    path.write_text("\n".join(lines) + "\n")
    given = {
        "plan": load_verification_plan(name),
        "artefacts": artefacts,
        "specification": example_specification(RANGE),
    }
    ours, theirs = verify(shown, **given), verify(read_points(path), **given)
    assert [row.label for row in ours.rows] == [row.label for row in theirs.rows]
    assert [row.value for row in ours.rows] == pytest.approx([row.value for row in theirs.rows], abs=1e-7)


def test_arms_are_told_by_the_seed_and_no_two_seeds_share_one():
    errors = PresetDistribution(ARM, load_preset("shop"))
    first, again = (taken(errors, n_arms=2, seed=7) for _ in range(2))
    assert [values(one) for one in first] == [values(one) for one in again]
    sizes = {values(one)["E_Uni, 1700"] for seed in (7, 8) for one in taken(errors, n_arms=2, seed=seed)}
    assert len(sizes) == 4


# Outcomes ------------------------------------------------------------------------------------------------------------


def test_distributions_are_quantiles_and_shares_over_the_arms():
    found = taken(MadeUp(noise_mm=0.006), n_arms=21)
    told = []
    simulate_verification(
        MadeUp(),
        posed(),
        plan=load_verification_plan("iso10360-12"),
        artefacts=exact(),
        specification=example_specification(RANGE),
        n_arms=3,
        seed=0,
        progress=told.append,
    )
    assert told == [1, 2, 3]
    shown = result_distributions(found)
    assert [one.label for one in shown] == [row.label for row in found[0].rows]
    size = np.sort(np.abs([one.rows[0].value for one in found]))
    assert (shown[0].median, shown[0].quantile_95) == pytest.approx(
        (size[10], size[19])
    )  # of 21: the 11th and the 20th
    assert shown[0].limit == 0.025
    for one in shown:
        assert one.conform + one.not_conform + one.undecided == (0 if one.limit is None else pytest.approx(1))
    assert sum(verdict_shares(found).values()) == pytest.approx(1)
    labels = [one.label for one in result_distributions(taken(MadeUp(), name="asme-b89.4.22"))]
    assert labels.count("SPAT.Max, position 1") == 1
    assert len(set(labels)) == len(labels)


def test_how_sure_a_share_is():
    """None of n: the upper bound p has (1 - p)^n = 2.5 %; 1 of 2: (1 - p)^2 = 2.5 % below it; and mirrored."""
    for n in (1, 5, 100):
        assert proportion_interval(0, n) == (0.0, pytest.approx(1 - 0.025 ** (1 / n)))
        assert proportion_interval(n, n) == (pytest.approx(0.025 ** (1 / n)), 1.0)
    assert proportion_interval(1, 2) == pytest.approx((1 - 0.975**0.5, 0.975**0.5))


@given(st.integers(1, 200), st.data())
def test_bounds_of_a_share_hold_as_many_draws_as_they_say(n, data):
    """At either bound, as many or more (as few or fewer) come with 2.5 %: sums of binomial probabilities."""
    count = data.draw(st.integers(1, n - 1) if n > 1 else st.just(1))
    low, high = proportion_interval(count, n)
    assert 0 < low < count / n <= high <= 1
    assert binom.sf(count - 1, n, low) == pytest.approx(0.025, rel=1e-6)
    if count < n:
        assert binom.cdf(count, n, high) == pytest.approx(0.025, rel=1e-6)


def test_an_arm_that_errs_beyond_measure_is_refused():
    with pytest.raises(InputError, match=r"virtual arm 1: test 'uni', .*measured 159 mm, .* of 'bar' is 150 mm") as no:
        taken(MadeUp(lambda tips: 0.06 * tips * [0, 1, 0]))
    assert "smaller errors" in no.value.hint
    refuses("expected 1 to 100000 virtual arms, got 0", taken, MadeUp(), n_arms=0)
