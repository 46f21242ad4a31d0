"""Models with terms of every basis at every place, their coefficients planted: no long fit stands behind them."""

import pickle
from dataclasses import replace
from functools import cache

import numpy as np

import truearm as ta
from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.terms import (
    Column,
    Constant,
    Direction,
    GravityTorque,
    Harmonics,
    InSession,
    LinkMasses,
    Temperature,
    Term,
)
from truearm.models.training_conditions import InputRange
from truearm.readings import Session


def rail_arm() -> Arm:
    """An arm that slides along a rail, turns four times, one joint sliding among them, hung from a ceiling."""
    ur = ta.load_arm("ur10").chain
    fixed = [ur.fixed[0], ur.fixed[1], *ur.fixed[1:5]]
    chain = Chain(np.array(fixed), np.array([10.0, 20.0, 30.0]), np.array([True, False, False, True, False]))
    masses = LinkMasses(np.array([20.0, 8, 4, 2, 1]), np.arange(15.0).reshape(5, 3) * 10)
    upside = np.array([0.0, 0.1, 1.0])
    return Arm("rail", chain, masses=masses, gravity_in_base=upside, working_pose=np.array([100.0, 0.3, 0.5, 50, 1]))


def angles_of(arm: Arm, n: int, seed: int = 0) -> np.ndarray:
    """(n, n_joints) joints about the working pose."""
    width = np.where(arm.chain.is_prismatic, 150.0, 1.2)
    return arm.working + width * np.random.default_rng(seed).uniform(-1, 1, (n, arm.n_joints))


def every_term(arm: Arm) -> list[Term]:
    """Terms of every basis; every place has some, the base and the tip among them."""
    n, terms = arm.n_joints, []

    def add(place, axis, basis, std):
        terms.append(Term(f"term {len(terms)}", place, tuple(np.eye(6)[axis]), basis, "all", std))

    for place in range(n + 2):
        for axis in range(6):
            add(place, axis, Constant(), 0.3 if place == 0 else 2e-3 if axis < 3 else 2.0)
    turning = [int(i) + 1 for i in np.flatnonzero(~arm.chain.is_prismatic)]
    for joint in turning:
        add(joint, 2, Harmonics(joint, (1, 2, 3, 40)), 1e-3)
        add(joint, 0, Harmonics(turning[0], (1, 2)), 1e-3)
        add(joint, 4, GravityTorque(joint, 1), 1e-2)
        add(joint, 1, GravityTorque(joint, 0), 2e-5)
        add(joint, 2, Direction(joint), 1e-4)
        add(joint, 3, Temperature(joint), 1e-2)
    for axis in (0, 1, 2):
        add(0, axis, GravityTorque(0, axis), 2e-5)
    add(2, 5, Column("load_kg"), 0.1)
    add(n + 1, 4, Temperature(n), 1e-2)
    add(0, 3, InSession("second"), 5.0)
    return terms


def without_some_coefficients(model: ta.KinematicModel) -> ta.KinematicModel:
    """The model with every third term only uncertain, as those that a kinematic model lacks."""
    for columns in model.fit_.perturbed_chain.columns[::3]:
        model.fit_.coefficients[columns] = 0.0
    return model


@cache
def _fitted(pickled_arm: bytes, seed: int) -> bytes:
    """A fitted model, once for all tests that plant terms in it."""
    arm = pickle.loads(pickled_arm)
    angles, noise = angles_of(arm, 80, seed), np.random.default_rng(seed).normal(0, 0.05, (80, 3))
    return pickle.dumps(ta.KinematicModel(arm).fit(angles, arm.chain.tip_in_base(angles) + noise))


def planted_model(arm: Arm, terms: list[Term] | None = None, *, seed: int = 1) -> ta.KinematicModel:
    """A fitted model whose terms and coefficients are then replaced."""
    rng = np.random.default_rng([seed, 1])
    model = pickle.loads(_fitted(pickle.dumps(arm), seed))
    terms = every_term(arm) if terms is None else terms
    std = np.concatenate([term.prior_stds for term in terms])
    root = rng.normal(size=(len(std), len(std))) * std * 1e-2
    model.fit_ = replace(
        model.fit_,
        perturbed_chain=PerturbedChain(arm.chain, tuple(terms)),
        coefficients=std * rng.normal(size=len(std)),
        covariance=root.T @ root,
        prior_std=std,
    )
    model.training_ = replace(
        model.training_,
        temperature_degC=InputRange(23.4, 0.5, 21.0, 25.0),
        columns={"load_kg": InputRange(2.5, 1.0, 0.0, 5.0)},
        has_directions=True,
    )
    beyond = model.variance_function_.beyond
    narrower = beyond.ranges + 0.2 * np.ptp(beyond.ranges, axis=1)[:, None] * [1, -1]  # of readings some stand alone
    model.variance_function_ = replace(
        model.variance_function_, beyond=replace(beyond, ranges=narrower, growth=0.5, nominal=2000.0)
    )
    return model


@cache
def empty_models() -> list[ta.NominalModel | ta.KinematicModel]:
    """Models of an arm that is as drawn, without any free constant."""
    arm = ta.load_arm("ur10")
    angles = angles_of(arm, 60)
    points = arm.chain.tip_in_base(angles) + np.random.default_rng(3).normal(0, 0.05, (60, 3))
    models = [ta.NominalModel(arm, free=()).fit(angles, points), ta.KinematicModel(arm, free=()).fit(angles, points)]
    for model in models:
        model.fit_ = replace(
            model.fit_,
            perturbed_chain=PerturbedChain(arm.chain, ()),
            coefficients=np.zeros(0),
            covariance=np.zeros((0, 0)),
            prior_std=np.zeros(0),
        )
    assert not any(len(model.fit_.coefficients) for model in models)
    return models


def stated_readings(arm: Arm, n: int = 30, seed: int = 5) -> Session:
    """Readings that state everything that a term may depend on."""
    rng = np.random.default_rng(seed)
    return Session(
        angles_of(arm, n, seed),
        temperature_degC=rng.uniform(20, 26, n),
        directions=rng.choice([-1.0, 0.0, 1.0], (n, arm.n_joints)),
        columns={"load_kg": rng.uniform(0, 5, n)},
    )


def network_model(activation: str = "tansig", members: int = 2) -> ta.NetworkModel:
    """A small network of the five-axis arm of the paper."""
    session = ta.simulate("gao2017", poses=60, seed=1).session
    options = {"hidden": (4, 3), "epochs": 3, "n_members": members, "activation": activation}
    return ta.NetworkModel(ta.load_arm("gao2017"), **options).fit(session.angles, session.points)
