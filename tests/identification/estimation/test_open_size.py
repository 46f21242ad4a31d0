"""An arm read in seats alone has the size of its drawing, with the uncertainty of its lengths."""

import numpy as np

import truearm as ta


def off_in_size(seed):
    """By what share a virtual arm is larger than it was identified from seats, and the standard uncertainty of that."""
    seats = {"strategy": "seat", "reference": False, "seats": 4, "preset": "research"}
    session = ta.simulate("measuring7", poses=40, arm_seed=seed, seed=1, **seats).session
    test = ta.simulate("measuring7", strategy="measuring", poses=60, arm_seed=seed, seed=2).session
    model = ta.fit("measuring7", session, model="kinematic").model
    about = [one - one.mean(axis=0) for one in (model.predict_readings(test), test.points)]
    found, true = ((one**2).sum() for one in about)
    fit = model.fit_
    by = np.concatenate(
        [by for *_, by in fit.perturbed_chain.derivatives(model.at(test).state, fit.coefficients)], axis=2
    )
    of_size = np.einsum("pcn,nc->p", by, about[0]) / found
    return 0.5 * np.log(true / found), np.sqrt(of_size @ fit.covariance @ of_size)


def test_its_size_is_off_by_what_is_stated():
    off, u = np.array([off_in_size(seed) for seed in range(3)]).T
    # Of three arms the root mean square is known to two fifths; it was ten times as much.
    assert 0.3 < np.sqrt(((off / u) ** 2).mean()) < 1.9
    assert (u > 5e-5).all()
