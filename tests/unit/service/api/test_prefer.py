from __future__ import annotations

import pytest
from fastapi import Response

from service.api.prefer import WAIT_SECONDS, _wait, preferences


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
        (['foo="a, wait=5'], {}),
        (['wait=5, foo="' + '\\"' * 16000], {"wait": "5"}),  # not tried from each quote anew
        (['wait=5, foo="' + '\\"' * 16000 + "\\"], {"wait": "5"}),
        ([",,;,wait=2"], {"wait": "2"}),
    ],
)
def test_the_header_is_read_as_the_rfc_says(headers: list[str], found: dict[str, str]) -> None:
    assert preferences(headers) == found


@pytest.mark.parametrize("headers", [None, [], ["wait"], ["wait=-1"], ["wait=1.5"], ["wait=x"]])
def test_who_names_no_seconds_waits_for_none(headers: list[str] | None) -> None:
    response = Response()
    assert _wait(response, headers) == 0
    assert "Preference-Applied" not in response.headers


@pytest.mark.parametrize(
    ("asked", "waited"), [(0, 0), (1, 1), (WAIT_SECONDS, WAIT_SECONDS), (10**8, WAIT_SECONDS)]
)
def test_a_wait_is_as_long_as_asked_within_bounds_and_told(asked: int, waited: int) -> None:
    response = Response()
    assert _wait(response, [f"wait={asked}"]) == waited
    assert response.headers["Preference-Applied"] == f"wait={waited}"
