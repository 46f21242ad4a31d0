"""Calls that must be refused."""

from collections.abc import Callable

import pytest

from truearm.errors import InputError


def refuses(said: str | None, call: Callable[..., object], /, *arguments: object, **options: object) -> InputError:
    """The error of a call that is refused with a message that holds this pattern, where one is given."""
    with pytest.raises(InputError, match=said) as caught:
        call(*arguments, **options)
    return caught.value
