"""The page about planning says what the program does."""

from pathlib import Path

import numpy as np

from truearm.arm.catalogue import load_arm
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.terms.catalogue import constants
from truearm.identification.terms.state import ArmState
from truearm.wings.planning.designs import candidates, exchange, information

PAGE = Path(__file__).parents[4] / "docs" / "planning.md"


def test_a_design_problem_of_ones_own_and_more_places_of_the_bar_leave_less():
    """The base is free: no term."""
    arm = load_arm("measuring7")
    terms = [term for term in constants(arm.chain, free=("tip",)) if term.place > 0]
    prior_std = np.concatenate([term.prior_stds for term in terms])
    places = candidates.bar_places(arm, 40, length_mm=500, poses=5, seed=0)  # five poses at each end
    problem = information.design_problem(
        PerturbedChain(arm.chain, tuple(terms)),
        places,
        ArmState(arm.chain, places.angles),
        ArmState(arm.chain, candidates.volume_poses(arm, 200, seed=1)),
        prior_precision=np.diag(prior_std**-2),
        noise_mm=0.02,
        length_u_mm=0.005,
    )
    plan = exchange.select_candidates(problem, 4)
    course = problem.course(plan)
    assert len(course) == 5
    assert (np.diff(course) < 0).all()
    assert len(places.readings(plan)) == 4 * 10


def test_what_it_names_is_there():
    text = PAGE.read_text(encoding="utf-8")
    for name in ("seat_poses", "bar_places", "tracker_poses"):
        assert f"`{name}`" in text
        assert callable(getattr(candidates, name))
    for name, module in (("design_problem", information), ("select_candidates", exchange)):
        assert f"`{name}`" in text
        assert callable(getattr(module, name))
    for strategy in exchange.OPTIMAL:
        assert f"*{strategy.capitalize()}*" in text
