"""Laws of proposals: strategies compared, places before poses, ranks known from theory, courses that fall."""

import numpy as np
import pytest
from test_candidates import gantry

from refusals import refuses
from truearm.arm.catalogue import load_arm
from truearm.wings.planning.designs.exchange import moment_matrix
from truearm.wings.planning.designs.information import tip_jacobian
from truearm.wings.planning.designs.plan import limitations
from truearm.wings.planning.designs.prior import nominal_prior
from truearm.wings.planning.designs.proposal import STRATEGIES, Artefact, information_rows, propose
from truearm.wings.planning.designs.sampling import Sector

ARM = load_arm("gen3lite")
pytestmark = pytest.mark.usefixtures("quick_plans")

KNOWN = nominal_prior(ARM, terms="constants", noise_mm=0.02)
ARTEFACTS = {"tracker": Artefact("tracker"), "seat": Artefact("seat", 3), "bar": Artefact("bar", 2, 200.0)}
N = 18


@pytest.fixture(scope="module", params=["tracker", "seat", pytest.param("bar", marks=pytest.mark.weekly)])
def plan(request, quick_plans):
    return propose(ARM, KNOWN, ARTEFACTS[request.param], N, seed=1)


def test_every_strategy_has_as_many_poses_and_its_course_falls(plan):
    assert tuple(plan.proposals) == STRATEGIES
    before = {float(proposal.rms_mm[0]) for proposal in plan.proposals.values()}
    assert max(before) == pytest.approx(min(before))
    for proposal in plan.proposals.values():
        assert len(proposal.poses) == len(proposal.poses.angles) == N
        assert (proposal.counts[0], proposal.counts[-1]) == (0, N)
        # A first pose in a seat tells nothing; rounding of a part in a million.
        assert (np.diff(proposal.rms_mm) < 1e-6 * proposal.rms_mm[:-1]).all()
        assert len(np.unique(proposal.poses.angles, axis=0)) == N


def test_optimal_poses_leave_least_where_they_are_optimal(plan):
    after = {name: proposal.rms_mm[-1] for name, proposal in plan.proposals.items()}
    assert after["i-optimal"] <= 1.001 * min(after.values())
    assert after["i-optimal"] < 0.9 * after["technician"]
    # O1 is the root of the determinant: the confidence ellipsoid.
    best = max(plan.proposals, key=lambda name: plan.proposals[name].observability.o1)
    assert best == "d-optimal"


def test_the_rank_is_that_of_theory(plan):
    """4 n - 3 by points or with a length, one less by seats alone: the scale is not told (n joints, all turning)."""
    expected = 4 * ARM.n_joints - (4 if plan.artefact.kind == "seat" else 3)
    assert {proposal.observability.rank for proposal in plan.proposals.values()} == {expected}


def test_what_is_left_follows_from_the_rows_told(plan):
    tips, J = tip_jacobian(KNOWN.perturbed_chain, KNOWN.state(plan.volume))
    target = moment_matrix(J, tips, scale=plan.artefact.kind == "seat")
    for proposal in plan.proposals.values():
        after = KNOWN.updated(information_rows(KNOWN, proposal.poses))
        # Seats and frame have wide priors in the one and none in the other: a hundred-thousandth.
        assert np.sqrt(np.vdot(target, after.covariance)) == pytest.approx(proposal.rms_mm[-1], rel=1e-4)


def test_poses_come_place_after_place(plan):
    for proposal in plan.proposals.values():
        poses = proposal.poses
        if plan.artefact.kind == "tracker":
            assert poses.seat is None
            continue
        for names in (poses.place, poses.seat):
            assert 1 + (names[1:] != names[:-1]).sum() == len(np.unique(names))
        assert len(np.unique(poses.place)) <= plan.artefact.places
        assert np.abs(ARM.chain.tip_in_base(poses.angles) - poses.seat_points).max() < 2e-6
    if plan.artefact.kind != "tracker":
        _, counts = np.unique(plan.proposals["technician"].poses.seat, return_counts=True)
        assert np.ptp(counts) <= 1


def test_limitations_name_what_seats_cannot_identify(plan):
    said = " ".join(limitations(plan, plan.proposals["i-optimal"]))
    assert ("Not identifiable from this plan: the base position." in said) == (plan.artefact.kind != "tracker")
    if plan.artefact.kind == "seat":
        assert "The scale is uncertain" in said
        assert "One known length between two seats" in said
    assert "effects without a term" in said


def test_a_joint_that_hardly_moves_is_named():
    narrow = Sector(0.5, 0.55, -0.02, 0.02, 5.0)
    plan = propose(ARM, KNOWN, Artefact("tracker"), 3, volume=narrow, seed=0)
    proposal = plan.proposals["technician"]
    said = limitations(plan, proposal)
    moved = np.degrees(np.ptp(proposal.poses.angles, axis=0))
    joints = [f"J{joint}" for joint in range(1, 7)]
    named = {name for name in joints if any(f"each turn of {name}." in sentence for sentence in said)}
    assert named == {name for name, degrees in zip(joints, moved, strict=True) if degrees < 90}
    assert named
    assert any("outside the joint angles of this plan" in sentence for sentence in said)


def test_the_same_seed_gives_the_same_plan_and_progress_is_told():
    told = []
    asked = {"seed": 3, "to_measure": "i-optimal"}
    first = propose(ARM, KNOWN, ARTEFACTS["tracker"], 6, **asked, progress=lambda done, note: told.append((done, note)))
    again = propose(ARM, KNOWN, ARTEFACTS["tracker"], 6, **asked)
    for name in STRATEGIES:
        assert (first.proposals[name].poses.angles == again.proposals[name].poses.angles).all()
    assert [done for done, _ in told] == sorted(done for done, _ in told)
    assert told[-1][0] < len(STRATEGIES)
    assert any(note.startswith("i-optimal: exchange") for _, note in told)


def test_an_arm_that_cannot_point_its_stylus_has_no_technician():
    arm, volume = gantry(), Sector(0.1, 1.0, -1.0, 1.0, 90)
    plan = propose(arm, nominal_prior(arm, noise_mm=0.1), Artefact("tracker"), 5, volume=volume)
    assert set(plan.proposals) == set(STRATEGIES) - {"technician"}
    refuses("five joints", propose, arm, nominal_prior(arm, noise_mm=0.1), Artefact("seat", 1), 5, volume=volume)


@pytest.mark.parametrize(
    ("make", "why"),
    [
        (lambda: Artefact("bar", 2), "needs the length"),
        (lambda: Artefact("seat", 2, 100.0), "artefact bar"),
        (lambda: Artefact("tracker", 2), "artefacts seat and bar"),
        (lambda: Artefact("seat", 0), "at least one of places"),
        (lambda: propose(ARM, KNOWN, Artefact("seat", 3), 5), "two poses or more for each of 3 seats"),
        (lambda: propose(ARM, KNOWN, Artefact("bar", 3, 200.0), 11), "each of 6 seats"),
        (lambda: propose(ARM, KNOWN, Artefact("tracker"), 0), "at least one of poses"),
        (lambda: propose(ARM, KNOWN, Artefact("tracker"), 5, seed=-1), "seed"),
        (lambda: propose(ARM, KNOWN, Artefact("bar", 1, 1e5), 10), "hardly fits"),
    ],
)
def test_what_cannot_be_is_refused(make, why):
    refuses(why, make)
