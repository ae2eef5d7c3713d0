import math

import pytest
import typer

from service.cli.files import written_path
from service.cli.parameters import a_number, output


def test_nan_is_no_number_of_seconds() -> None:
    assert a_number(1.5) == 1.5
    assert a_number(None) is None
    with pytest.raises(typer.BadParameter, match="nan is no number"):
        a_number(math.nan)


def test_every_output_is_given_and_read_alike() -> None:
    option = output("DIR", "Folder of results.")
    assert option.parser is written_path
    assert (option.metavar, option.help) == ("DIR", "Folder of results.")
