"""What arms of one type have in common: the prior of an arm's constants, and the file that keeps it.

The file is TOML: format and version of truearm; name of the nominal arm and the hash of its kinematics; the arms that
it was learned from; what it gained on arms held out; mean and standard deviation of each constant; the same without
each part of the arms, for the arms of that part.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.files.toml_documents import Document, Name, NotNegative, Positive, Real, read_document, toml_text
from truearm.identification.terms.basis import Constant
from truearm.identification.terms.catalogue import constants
from truearm.identification.terms.term import Term

FORMAT = 2
MAX_CONSTANTS, MAX_ARMS, MAX_PARTS = 1000, 20_000, 100
# Decimals of lengths [mm] and cosines in the hash of an arm: beyond the last bit of a processor.
DECIMALS = 6


class ConstantPrior(Document):
    """Prior of a constant.

    Attributes
    ----------
    name : str
        Of its term.
    mean, std : float
        Difference from the nominal arm: mean over the type, and standard deviation of an arm about it [rad, or mm].
    mean_u : float
        Standard uncertainty of the mean.
    """

    name: Name
    mean: Real
    mean_u: Positive
    std: Positive


class HeldOutGain(Document):
    """What a type prior gains on arms that it was not learned from.

    Attributes
    ----------
    n_readings : int
        Of each arm, from which its other readings are predicted.
    n_arms : int
    error_ratio, error_ratio_u : float
        Error that the prior leaves over that without it, geometric mean over the arms, and its standard uncertainty;
        of an error, only the part that more readings of the arm would remove.
    """

    n_readings: Annotated[int, Field(strict=True, ge=1)]
    n_arms: Annotated[int, Field(strict=True, ge=2)]
    error_ratio: Positive
    error_ratio_u: NotNegative

    def __str__(self) -> str:
        return f"{self.error_ratio:.2f} of the error after {self.n_readings} readings"


class HeldOutPart(Document):
    """The constants as the other arms have them, in the order of `TypePrior.constants`.

    Attributes
    ----------
    arms : tuple of str
        Serial numbers of the part that is held out.
    mean, mean_u, std : tuple of float
        See `ConstantPrior`.
    """

    arms: Annotated[tuple[Name, ...], Field(min_length=1, max_length=MAX_ARMS)]
    mean: Annotated[tuple[Real, ...], Field(max_length=MAX_CONSTANTS)]
    mean_u: Annotated[tuple[Positive, ...], Field(max_length=MAX_CONSTANTS)]
    std: Annotated[tuple[Positive, ...], Field(max_length=MAX_CONSTANTS)]


class TypePrior(Document):
    """What arms of one type have in common.

    Attributes
    ----------
    format : int
    truearm : str
        Version that wrote it.
    arm : str
        Name of the nominal arm.
    arm_sha256 : str
        Hash of its kinematics from the first joint to the flange.
    arms : tuple of str
        Serial numbers of the arms that it was learned from.
    gains : tuple of HeldOutGain
    constants : tuple of ConstantPrior
    held_out : tuple of HeldOutPart
        Every arm is in one part; none where the arms of a part are removed already.
    """

    format: Annotated[int, Field(strict=True, ge=FORMAT, le=FORMAT)]
    truearm: Name
    arm: Name
    arm_sha256: Annotated[str, Field(strict=True, pattern="^[0-9a-f]{64}$")]
    arms: Annotated[tuple[Name, ...], Field(min_length=2, max_length=MAX_ARMS)]
    gains: Annotated[tuple[HeldOutGain, ...], Field(min_length=1, max_length=10)]
    constants: Annotated[tuple[ConstantPrior, ...], Field(min_length=1, max_length=MAX_CONSTANTS)]
    held_out: Annotated[tuple[HeldOutPart, ...], Field(max_length=MAX_PARTS)]

    @model_validator(mode="after")
    def _parts_have_all_constants(self) -> Self:
        n = len(self.constants)
        for part in self.held_out:
            if {len(part.mean), len(part.mean_u), len(part.std)} != {n}:
                raise ValueError(f"expected {n} of mean, mean_u and std without {part.arms[0]}")
        return self

    def check_arm(self, arm: Arm) -> None:
        """Check that this is the prior of an arm's type.

        Raises
        ------
        InputError
            If it is of another nominal arm, or not of all of its constants.
        """
        if self.arm_sha256 != kinematics_sha256(arm):
            raise InputError(
                f"expected a type prior of arm {arm.name!r}, got one of {self.arm!r}"
                + (", of other dimensions" if self.arm == arm.name else ""),
                hint="truearm fleet prior FOLDER --arm ARM --out FILE learns one",
            )
        expected, given = [term.name for term in type_constants(arm.chain)], [one.name for one in self.constants]
        if sorted(expected) != sorted(given):
            different = min(set(expected) ^ set(given), default="one twice")
            raise InputError(f"expected the {len(expected)} constants of arm {arm.name!r}, each once, got {different}")

    def without(self, serial_number: str) -> TypePrior:
        """The prior for an arm: of one that it was learned from, what the arms of the other parts have in common.

        Raises
        ------
        InputError
            If it was learned from this arm, and does not have the others alone.
        """
        if serial_number not in self.arms:
            return self
        part = next((one for one in self.held_out if serial_number in one.arms), None)
        if part is None:
            raise InputError(
                f"the prior was learned from {serial_number} too, whose readings would count twice",
                hint="fit it without --prior, or learn the prior again: truearm fleet prior",
            )
        values = zip(self.constants, part.mean, part.mean_u, part.std, strict=True)
        constants = tuple(ConstantPrior(name=one.name, mean=m, mean_u=u, std=s) for one, m, u, s in values)
        others = tuple(name for name in self.arms if name not in part.arms)
        return self.model_copy(update={"arms": others, "constants": constants, "held_out": ()})

    def __str__(self) -> str:
        left = " and ".join(map(str, self.gains))
        return f"prior of type {self.arm} from {len(self.arms)} arms; on arms held out {left}"

    def applied(self, chain: Chain, terms: Sequence[Term]) -> tuple[Chain, list[Term]]:
        """The typical chain, and terms with the priors of the type; base and tip are as before.

        Means enter by the chain, about which terms have mean zero. The evidence may still scale a group, if an arm is
        less like its type.
        """
        known, motions, found = {one.name: one for one in self.constants}, np.zeros((chain.n_places, 6)), []
        for term in terms:
            one = known.get(term.name) if term.learn and isinstance(term.basis, Constant) else None
            if one is not None:
                motions[term.place] += one.mean * np.array(term.direction)
                term = replace(term, prior_std=one.std)
            found.append(term)
        return chain.with_motions(motions) if motions.any() else chain, found

    def save(self, path: str | Path) -> None:
        """Write the file, whole or not at all."""
        lines = [f"format = {self.format}"]
        lines += [f"{name} = {toml_text(getattr(self, name))}" for name in ("truearm", "arm", "arm_sha256")]
        lines.append(f"arms = {_toml_value(self.arms)}")
        for name in ("gains", "constants", "held_out"):
            for one in getattr(self, name):
                lines += ["", f"[[{name}]]", *(f"{key} = {_toml_value(value)}" for key, value in one)]
        with atomic_file(path, read=read_type_prior) as temporary:
            temporary.write_text("\n".join([*lines, ""]), encoding="utf-8")


def _toml_value(value: str | float | tuple[str | float, ...]) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml_value, value))}]"
    return toml_text(value) if isinstance(value, str) else repr(value)


def read_type_prior(path: str | Path) -> TypePrior:
    """Read the file of a type prior.

    Raises
    ------
    InputError
        If the file is missing, too large, or not what it must be.
    """
    return read_document(path, TypePrior)


def type_constants(chain: Chain) -> list[Term]:
    """The constants that arms of a type may have in common: without base and tip, and what is equivalent to them."""
    return [term for term in constants(chain) if term.learn]


def kinematics_sha256(arm: Arm) -> str:
    """Hash of what drawings of a type have in common: from the first joint to the flange, without base and tip."""
    chain = arm.chain
    coupling = np.eye(chain.n_joints) if chain.coupling is None else chain.coupling
    lengths = (np.round(part, DECIMALS) + 0.0 for part in (chain.fixed[1:], coupling))  # -0.0 is 0.0
    content = [chain.is_prismatic.tobytes(), *(part.astype("<f8").tobytes() for part in lengths)]
    return hashlib.sha256(b"".join(content)).hexdigest()
