"""Fitted models of small arms with known truth, once per session."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from truearm.arm import Arm, Chain, load_arm
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.terms import ArmState, Constant, Harmonics, Term
from truearm.models import Compensator, NetworkModel, PhysicalModel
from truearm.readings import Session
from truearm.wings.planning.virtual import VirtualArm


@dataclass(frozen=True)
class Case:
    """A fitted model, its arm as it is, and joints inside its trained range."""

    model: Compensator
    true_tip: Callable[[np.ndarray], np.ndarray]
    joints: np.ndarray


def virtual_case(name: str, *, highest: int) -> Case:
    arm = load_arm(name)
    virtual = VirtualArm.draw(arm, "research", seed=1)
    low, high = np.maximum(arm.lower, arm.working - 1.0), np.minimum(arm.upper, arm.working + 1.0)
    rng = np.random.default_rng(2)
    readings = virtual.measure(rng.uniform(low, high, (250, arm.n_joints)), seed=3).readings
    model = PhysicalModel(arm, highest=highest).fit_readings(readings)
    middle, half = (low + high) / 2, (high - low) / 2
    return Case(model, virtual.true_tip, middle + 0.8 * half * rng.uniform(-1, 1, (12, arm.n_joints)))


def planted_case(arm: Arm, low: np.ndarray, high: np.ndarray) -> Case:
    """An arm with planted constants and harmonics of every turning joint."""
    rng = np.random.default_rng(7)
    terms = []
    for place in range(1, arm.n_joints + 1):
        terms.append(
            Term(f"c{place}", place, tuple(rng.normal(size=6) * np.repeat([1e-3, 0.3], 3)), Constant(), "c", 1.0)
        )
        if not arm.chain.is_prismatic[place - 1]:
            terms.append(Term(f"h{place}", place, (0, 0, 5e-4, 0, 0, 0), Harmonics(place, (1, 2)), "h", 1.0))
    truth = PerturbedChain(arm.chain, tuple(terms))
    x = np.concatenate([rng.normal(size=term.n_coefficients) for term in terms])

    def true_tip(joints):
        return truth.tips(ArmState.of(arm, joints), x)

    joints = rng.uniform(low, high, (250, arm.n_joints))
    points = true_tip(joints) + rng.normal(0, 0.01, (250, 3))
    model = PhysicalModel(arm, highest=2).fit_readings(Session(joints, points))
    return Case(model, true_tip, (low + high) / 2 + 0.4 * (high - low) * rng.uniform(-1, 1, (12, arm.n_joints)))


@pytest.fixture(scope="session")
def ur10() -> Case:
    """Six joints, errors of every kind."""
    return virtual_case("ur10", highest=4)


@pytest.fixture(scope="session")
def seven() -> Case:
    """Seven joints: a pose leaves one motion free."""
    return virtual_case("wam", highest=2)


@pytest.fixture(scope="session")
def rail() -> Case:
    """Six joints on a rail."""
    chain = load_arm("ur10").chain
    onto_rail = np.array([[0.0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]])
    fixed = np.concatenate([onto_rail[None], (np.linalg.inv(onto_rail) @ chain.fixed[0])[None], chain.fixed[1:]])
    arm = Arm(
        "on-a-rail",
        Chain(fixed, [0.0, 0.0, 90.0], [True] + [False] * 6),
        lower=np.array([0.0] + [-6.0] * 6),
        upper=np.array([2000.0] + [6.0] * 6),
    )
    middle = np.array([1000.0, 0.3, -1.2, 1.4, -1.0, 1.2, 0.2])
    half = np.array([800.0] + [0.8] * 6)
    return planted_case(arm, middle - half, middle + half)


@pytest.fixture(scope="session")
def five() -> Case:
    """Five joints: positions only."""
    chain = load_arm("ur10").chain
    arm = Arm("five", Chain(chain.fixed[:6], [0.0, 40.0, 90.0]))
    middle = np.array([0.3, -1.2, 1.4, -1.0, 1.2])
    return planted_case(arm, middle - 0.8, middle + 0.8)


@pytest.fixture(scope="session")
def network() -> Case:
    """A network: tips without kinematics."""
    arm = load_arm("ur10")
    virtual = VirtualArm.draw(arm, "research", seed=1)
    rng = np.random.default_rng(4)
    readings = virtual.measure(arm.working + 0.2 * rng.uniform(-1, 1, (600, 6)), seed=5).readings
    model = NetworkModel(arm, hidden=(10,), epochs=40, seed=1).fit_readings(readings)
    return Case(model, virtual.true_tip, arm.working + 0.15 * rng.uniform(-1, 1, (12, 6)))
