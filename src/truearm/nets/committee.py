"""A committee of networks, each trained without one fold of the samples: their mean predicts, their scatter warns.

A network's outputs at the samples of its fold are predictions of samples that it has not seen. The committee thus comes
with its own cross-validation. Sources: A. Krogh, J. Vedelsby, "Neural network ensembles, cross validation, and active
learning", NIPS 7 (1995) 231; intervals from such residuals: R. F. Barber, E. J. Candes, A. Ramdas, R. J. Tibshirani,
"Predictive inference with the jackknife+", Ann. Statist. 49 (2021) 486, section 3 (CV+).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from truearm.errors import InputError
from truearm.nets.levenberg_marquardt import BayesianRecord, trainbr
from truearm.nets.normal_equations import FitProblem
from truearm.nets.perceptron import Perceptron, nguyen_widrow
from truearm.typing import BoolArray, FloatArray, IntArray

# Samples of a member's training, as a multiple of its weights. With three outputs the weights then take up a 36th of
# the freedom at most; more samples cost time and change the predictions by less than the scatter of the members.
SAMPLES_PER_WEIGHT = 12


@dataclass(frozen=True, eq=False)
class Committee:
    """Networks of one shape.

    Attributes
    ----------
    network : Perceptron
    weights : (k, n_weights) array
        Of every member.
    effective : (k,) array
        Effective number of weights of every member, MATLAB's ``gamk``.
    epochs : (k,) int array
        Epochs of every member's training.
    """

    network: Perceptron
    weights: FloatArray
    effective: FloatArray
    epochs: IntArray

    def outputs(self, inputs: FloatArray) -> FloatArray:
        """(k, n_outputs, n) outputs of the members for inputs (n_inputs, n)."""
        return np.stack([self.network.outputs(weights, inputs) for weights in self.weights])


def train_committee(
    network: Perceptron,
    inputs: FloatArray,
    targets: FloatArray,
    fold: IntArray,
    *,
    epochs: int,
    seed: int,
    callback: Callable[[int], None] | None = None,
) -> tuple[Committee, FloatArray]:
    """Train one network by `trainbr` for each fold, without the fold.

    Parameters
    ----------
    network : Perceptron
    inputs, targets : (n_inputs, n), (n_outputs, n) array
        Scaled, samples in columns.
    fold : (n,) int array
        Fold of every sample: 0, 1, ... k - 1, with two folds or more.
    epochs : int
        Maximum epochs of a training.
    seed : int
        Of the start weights, and of the samples chosen where there are more than the training needs.
    callback : callable, optional
        Called with the number of members trained.

    Returns
    -------
    committee : Committee
    held_out : (n_outputs, n) array
        Output for every sample of the member that was trained without it.

    Raises
    ------
    InputError
        If a fold is missing or holds all samples.
    """
    n_folds = int(fold.max(initial=-1)) + 1
    if n_folds < 2 or not (np.bincount(fold, minlength=n_folds) > 0).all():
        raise InputError(f"expected two folds or more, numbered from 0, got {np.unique(fold).tolist()[:10]}")
    held_out = np.empty(targets.shape)
    weights, effective, done = [], [], []
    for member in range(n_folds):
        trained, record = train_member(network, inputs, targets, fold != member, epochs=epochs, seed=[seed, member])
        held_out[:, fold == member] = network.outputs(trained, inputs[:, fold == member])
        weights.append(trained)
        effective.append(float(record.gamk[-1]))
        done.append(record.num_epochs)
        if callback is not None:
            callback(member + 1)
    return Committee(network, np.stack(weights), np.array(effective), np.array(done, dtype=np.intp)), held_out


def train_member(
    network: Perceptron, inputs: FloatArray, targets: FloatArray, used: BoolArray, *, epochs: int, seed: list[int]
) -> tuple[FloatArray, BayesianRecord]:
    """Weights and record of one network, trained by `trainbr` on the samples `used` (n,), or on enough of them."""
    columns = np.flatnonzero(used)
    most = SAMPLES_PER_WEIGHT * network.n_weights
    if len(columns) > most:
        rng = np.random.default_rng([*seed, *b"samples"])
        columns = np.sort(rng.choice(columns, most, replace=False))
    words = np.random.SeedSequence(seed).generate_state(2, np.uint64)
    start = nguyen_widrow(network, seed=int(words[0]) << 64 | int(words[1]))
    return trainbr(FitProblem(network, inputs[:, columns], targets[:, columns]), start, epochs=epochs)
