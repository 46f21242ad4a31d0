"""Short files of constants: their loss from two parts of the region, where users have ten."""

import pytest

from truearm.wings.exports.formats import rigid_arm


@pytest.fixture(scope="session", autouse=True)
def two_parts():
    """Refits are most of the time of an export."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rigid_arm, "N_PARTS", 2)
        yield
