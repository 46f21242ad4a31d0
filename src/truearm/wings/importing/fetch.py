"""Fetch: published readings of real arms."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from truearm.files.atomic_write import atomic_file
from truearm.readings import Lengths, Session, write_lengths, write_session
from truearm.verbs.record import Record, number_of
from truearm.wings.importing import datasets


def fetch(name: str) -> PublishedReadings:
    """Get the published readings of a real arm: downloaded once, checked against the published files.

    Parameters
    ----------
    name : str
        One of `datasets.DATASETS`.

    Returns
    -------
    PublishedReadings

    Raises
    ------
    InputError
        If there is no such set, a checksum does not fit, or it cannot be downloaded.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.fetch("ur10")
    Traceback (most recent call last):
    ...
    truearm.errors.InputError: ...
    """
    lengths = datasets.load_lengths(name)
    return PublishedReadings(name, datasets.load_readings(name), lengths, datasets.DATASETS[name])


@dataclass(frozen=True, eq=False, repr=False)
class PublishedReadings(Record):
    """Readings of a real arm that others measured and published.

    Attributes
    ----------
    name : str
    session : Session
    lengths : Lengths or None
        Known lengths between its seats; their uncertainty is an assumption of truearm.
    entry : DataSet
        Title, nominal arm and source.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.datasets.DATASETS["ur10-a"].arm
    'ur10'
    """

    name: str
    session: Session
    lengths: Lengths | None
    entry: datasets.DataSet

    @property
    def arm(self) -> str:
        """Name of the nominal arm in the catalogue."""
        return self.entry.arm

    @property
    def citation(self) -> str:
        """What to cite."""
        return datasets.CITATION[self.entry.source]

    @property
    def _repository(self) -> str:
        return f"github.com/{datasets.UPSTREAM[self.entry.source].rpartition('/')[0]}"

    def save(self, path: str | Path, *, lengths: str | Path | None = None) -> None:
        """Write the session, and the lengths to a file of their own: both or none."""
        with atomic_file(path) as beside:
            write_session(self.session, beside, angle_unit=self.entry.angle_unit)
            if lengths is not None and self.lengths is not None:
                write_lengths(self.lengths, lengths)

    def summary(self) -> str:
        """The answer in one sentence: how many readings of which arm."""
        return f"{number_of(len(self.session))} of {self.session.n_joints} joints, nominal arm {self.arm}."

    def blocks(self) -> Iterator[str]:
        """See `Record.blocks`."""
        yield self.summary()
        if self.lengths is not None:
            yield f"{len(self.lengths)} lengths between its seats; their uncertainty is our assumption."
        yield f"From {self._repository} (MIT licence). Cite: {self.citation}."

    def _json(self) -> object:
        return {
            **self._named("name", "arm"),
            "n_readings": len(self.session),
            "n_joints": self.session.n_joints,
            "n_lengths": 0 if self.lengths is None else len(self.lengths),
            "source": f"https://{self._repository}",
            "citation": self.citation,
        }
