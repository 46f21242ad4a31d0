"""A committee of networks: every member learns without its own fold, and the same from the same seed."""

import numpy as np
import pytest

from refusals import refuses
from truearm.nets.committee import SAMPLES_PER_WEIGHT, train_committee, train_member
from truearm.nets.perceptron import Perceptron

NETWORK = Perceptron.with_layers(1, (3,), 1)
INPUTS = np.linspace(-1, 1, 40)[None]
TARGETS = np.tanh(3 * INPUTS)
FOLD = np.arange(40) % 4


def test_a_member_does_not_see_its_fold():
    """Other targets in a fold change all members but its own, and so all held-out outputs but those of the fold."""
    committee, held_out = train_committee(NETWORK, INPUTS, TARGETS, FOLD, epochs=8, seed=1)
    changed = TARGETS + 0.5 * (FOLD == 2)
    other, held_out_then = train_committee(NETWORK, INPUTS, changed, FOLD, epochs=8, seed=1)
    same = (other.weights == committee.weights).all(axis=1)
    assert same.tolist() == [False, False, True, False]
    np.testing.assert_array_equal(held_out_then[:, FOLD == 2], held_out[:, FOLD == 2])
    assert (held_out_then[:, FOLD != 2] != held_out[:, FOLD != 2]).all()


def test_held_out_outputs_are_those_of_the_member_without_the_fold():
    done = []
    committee, held_out = train_committee(NETWORK, INPUTS, TARGETS, FOLD, epochs=8, seed=1, callback=done.append)
    own = committee.outputs(INPUTS)[FOLD, 0, np.arange(40)]
    np.testing.assert_allclose(held_out[0], own, rtol=1e-14)  # other chunks, other rounding
    assert np.abs(held_out - TARGETS).max() < 0.05  # a tansig unit can be the target itself
    assert done == [1, 2, 3, 4]
    assert (committee.epochs <= 8).all()
    assert ((committee.effective > 0) & (committee.effective <= NETWORK.n_weights)).all()
    again, _ = train_committee(NETWORK, INPUTS, TARGETS, FOLD, epochs=8, seed=1)
    np.testing.assert_array_equal(again.weights, committee.weights)
    assert (train_committee(NETWORK, INPUTS, TARGETS, FOLD, epochs=8, seed=2)[0].weights != committee.weights).any()


def test_a_training_takes_as_many_samples_as_its_weights_need():
    """Three times as many samples: the cost of the first epoch is that of `SAMPLES_PER_WEIGHT` a weight."""
    n = 3 * SAMPLES_PER_WEIGHT * NETWORK.n_weights
    inputs = np.linspace(-1, 1, n)[None]
    used = np.ones(n, dtype=bool)
    weights, record = train_member(NETWORK, inputs, np.tanh(3 * inputs), used, epochs=10, seed=[0, 0])
    assert np.abs(NETWORK.outputs(weights, inputs) - np.tanh(3 * inputs)).max() < 0.05
    assert record.num_epochs <= 10


@pytest.mark.parametrize("fold", [np.zeros(40, int), np.full(40, 1), 2 * (np.arange(40) % 2)])
def test_folds_that_do_not_divide_the_samples_are_refused(fold):
    refuses("two folds or more", train_committee, NETWORK, INPUTS, TARGETS, fold, epochs=1, seed=0)
