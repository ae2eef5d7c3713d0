from __future__ import annotations

import pytest

from service.api.prefer import preferences


@pytest.mark.parametrize(
    ("headers", "found"),
    [
        ([], {}),
        ([""], {}),
        (["wait=10"], {"wait": "10"}),
        (["Wait = 10"], {"wait": "10"}),
        (['wait="10"'], {"wait": "10"}),
        (["respond-async, wait=10"], {"respond-async": "", "wait": "10"}),
        (["respond-async", "wait=10"], {"respond-async": "", "wait": "10"}),
        (["wait=10, wait=20"], {"wait": "10"}),
        (["wait=10", "WAIT=20"], {"wait": "10"}),
        (["wait=10; unit=s, handling=lenient"], {"wait": "10", "handling": "lenient"}),
        (['foo="a, wait=5", wait=10'], {"foo": "a, wait=5", "wait": "10"}),
        (['foo="a \\" b"; x="y, z", wait=1'], {"foo": 'a " b', "wait": "1"}),
        (["await=10"], {"await": "10"}),
        (["wait"], {"wait": ""}),
        (["wait="], {}),
        (["=10, wait=3"], {"wait": "3"}),
        (["wait=1 0"], {}),
        (['wait="10'], {}),
        ([",,;,wait=2"], {"wait": "2"}),
    ],
)
def test_the_header_is_read_as_the_rfc_says(headers: list[str], found: dict[str, str]) -> None:
    assert preferences(headers) == found
