"""What arms of one type have in common: the prior of an arm's constants, and the file that keeps it.

The file is TOML: format and version of truearm; name of the nominal arm and the hash of its kinematics; the arms that
it was learned from; what it gained on arms held out; mean and standard deviation of each constant.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.files.toml_documents import Document, Name, NotNegative, Positive, Real, read_document, toml_text
from truearm.identification.terms.basis import Constant
from truearm.identification.terms.catalogue import constants
from truearm.identification.terms.term import Term

FORMAT = 1
MAX_CONSTANTS, MAX_ARMS = 1000, 20_000
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
    """

    format: Annotated[int, Field(strict=True, ge=1, le=FORMAT)]
    truearm: Name
    arm: Name
    arm_sha256: Annotated[str, Field(strict=True, pattern="^[0-9a-f]{64}$")]
    arms: Annotated[tuple[Name, ...], Field(min_length=2, max_length=MAX_ARMS)]
    gains: Annotated[tuple[HeldOutGain, ...], Field(min_length=1, max_length=10)]
    constants: Annotated[tuple[ConstantPrior, ...], Field(min_length=1, max_length=MAX_CONSTANTS)]

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
                hint="truearm fleet prior FOLDER --arm ARM --into FILE learns one",
            )
        expected, given = [term.name for term in type_constants(arm.chain)], [one.name for one in self.constants]
        if sorted(expected) != sorted(given):
            different = min(set(expected) ^ set(given), default="one twice")
            raise InputError(f"expected the {len(expected)} constants of arm {arm.name!r}, each once, got {different}")

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
        lines += ["arms = [", *(f"  {toml_text(one)}," for one in self.arms), "]"]
        for name in ("gains", "constants"):
            for one in getattr(self, name):
                lines += ["", f"[[{name}]]", *(f"{key} = {_toml_value(value)}" for key, value in one)]
        with atomic_file(path) as temporary:
            temporary.write_text("\n".join([*lines, ""]), encoding="utf-8")


def _toml_value(value: str | float) -> str:
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
