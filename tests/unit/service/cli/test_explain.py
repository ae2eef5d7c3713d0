from __future__ import annotations

import errno

import pytest
from sqlalchemy.exc import OperationalError

from drivers import BadAddressError, DriverError
from pipeline.errors import OptionError
from service.cli.explain import explain
from service.errors import UnknownJobError
from service.problems import DATABASE_AWAY
from service.sending.failures import RefusedError, ServiceAwayError
from service.workers.shortage import TOO_LITTLE_MEMORY

_FULL = "A disk is full that this writes to, that of what is printed perhaps: make room on it."


@pytest.mark.parametrize(
    "error",
    [
        OptionError("Give another number."),
        BadAddressError("No address."),
        RefusedError("The job was canceled."),
        UnknownJobError("a"),
    ],
)
def test_what_the_user_can_mend_is_the_errors_own_sentence(error: Exception) -> None:
    assert explain(error) == (str(error), 2)


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (MemoryError(), TOO_LITTLE_MEMORY),
        (OSError(errno.ENOMEM, "Cannot allocate memory"), TOO_LITTLE_MEMORY),
        (OSError(errno.ENOSPC, "No space left on device"), _FULL),
        (DriverError("The camera is gone."), "The camera is gone."),
        (ServiceAwayError("It does not answer."), "It does not answer."),
        (OperationalError("SELECT 1", None, OSError("secret")), DATABASE_AWAY.detail),
    ],
)
def test_what_the_user_cannot_mend_is_told_by_the_exit_code(
    error: Exception, sentence: str
) -> None:
    assert explain(error) == (sentence, 1)


def test_a_fault_of_the_program_is_told_with_its_place() -> None:
    with pytest.raises(ZeroDivisionError) as caught:
        _ = 1 // 0
    sentence, code = explain(caught.value)
    assert sentence.startswith("Something broke inside lightlayers, please report it: ZeroDivision")
    assert (" in test_explain.py, line " in sentence, code) == (True, 1)
