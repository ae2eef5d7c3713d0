"""Tables that people hand in: the two formats, and everything that can be wrong with them."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest

from pipeline.errors import OptionError
from pipeline.options import Sensitivities, Spectrum
from pipeline.spectra.tables import (
    parse_sensitivities,
    parse_spectrum,
    write_sensitivities,
    write_spectrum,
)
from pipeline.taken_with import TakenWith

CAMERA = "wavelength_nm,R,G,B\n400,0,0,1\n550,0,1,0\n700,1,0,0\n"
LIGHT = "wavelength_nm,power\n400,1\n550,2\n700,1\n"


def test_csv_of_a_camera() -> None:
    table = parse_sensitivities(CAMERA.encode())

    assert table.wavelength_nm == [400, 550, 700]
    assert (table.r, table.g, table.b) == ([0, 0, 1], [0, 1, 0], [1, 0, 0])


@pytest.mark.parametrize(
    "text",
    [
        LIGHT,
        "\ufeff" + LIGHT,
        LIGHT.replace("\n", "\r\n"),
        LIGHT.replace(",", " , "),
        LIGHT.upper(),
        "\n" + LIGHT + "\n\n",
    ],
    ids=["plain", "byte order mark", "CRLF", "spaces", "capitals", "empty lines"],
)
def test_csv_of_a_light_as_programs_write_it(text: str) -> None:
    table = parse_spectrum(text.encode())

    assert table.wavelength_nm == [400, 550, 700]
    assert table.power == [1, 2, 1]


def test_ampas_json(ampas: bytes) -> None:
    table = parse_sensitivities(ampas)

    assert len(table.wavelength_nm) == 81
    assert max(table.g) == pytest.approx(0.8)
    assert table.wavelength_nm[table.g.index(max(table.g))] == 540


def test_ampas_json_of_a_light() -> None:
    main = {"400": [1.0], "550": [2.0], "700": [1.0]}
    document = {"spectral_data": {"index": {"main": ["power"]}, "data": {"main": main}}}

    assert parse_spectrum(json.dumps(document).encode()).power == [1, 2, 1]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b"", "is empty"),
        (b"   \n", "is empty"),
        (b"\xff\xfe\x00\x01", "is not text"),
        (b"wavelength_nm,power\n", "has no rows"),
        (b"nm,power\n400,1\n700,1\n", "has the columns nm,power"),
        (b"400,1\n700,1\n", "has the columns 400,1"),
        (
            b"wavelength_nm,power\n400,one\n700,1\n",
            "holds 'one' in row 1, which is not a number: mend",
        ),
        (b"wavelength_nm,power\n400,1\n700\n", "has not 2 numbers"),
        (
            b"wavelength_nm,power\n400,1\n500,nan\n700,1\n",
            "has nan as power in row 2: it must be finite",
        ),
        (
            b"wavelength_nm,power\n400,1\ninf,1\n700,1\n",
            "has inf as wavelength_nm in row 2: it must be finite",
        ),
        (
            b"wavelength_nm,power\n400,1\n500,-1\n700,1\n",
            "has -1 as power in row 2: it must be 0 or more",
        ),
        (b"wavelength_nm,power\n700,1\n400,1\n", "must ascend"),
        (b"wavelength_nm,power\n400,1\n400,1\n700,1\n", "must ascend"),
        (b"wavelength_nm,power\n0.4,1\n0.7,1\n", "must cover 420 to 660 nm"),
        (b"wavelength_nm,power\n400,0\n700,0\n", "must not be all zero"),
        (b"wavelength_nm,power\n400,1\n", "has one row: send two or more, one per wavelength"),
        (b'wavelength_nm,power\n"400,1\n700,1', "has not 2 numbers|no CSV|not a number"),
        (
            b"wavelength_nm,power\n"
            + b"".join(b"%.1f,1\n" % (380 + row / 10) for row in range(4001)),
            "has 4,001 rows: send at most 2,000, in wider steps",
        ),
        (b"{", "is no AMPAS JSON"),
        (b"{}", "is no AMPAS JSON"),
        (b'{"spectral_data": []}', "is no AMPAS JSON"),
        (b'{"spectral_data": {"index": {"main": ["power"]}, "data": {"main": 5}}}', "AMPAS JSON"),
        (
            b'{"spectral_data": {"index": {"main": ["power"]},'
            b' "data": {"main": [[400, [1]], [null, [1]], [700, [1]]]}}}',
            "holds 'None' in row 2, which is not a number: mend",
        ),
        (b'{"a":' * 100_000, "is no AMPAS JSON"),
    ],
)
def test_what_is_wrong_with_a_table_is_said_in_one_sentence(text: bytes, reason: str) -> None:
    with pytest.raises(OptionError) as caught:
        parse_spectrum(text)

    sentence = str(caught.value)
    assert re.search(reason, sentence)
    assert sentence.startswith(("The light table", "A row of the light table"))
    assert sentence.endswith(".")
    assert "\n" not in sentence


@pytest.mark.parametrize("column", ["R", "G", "B"])
def test_a_camera_needs_three_columns(column: str) -> None:
    head = "wavelength_nm,R,G,B".replace("," + column, "")
    with pytest.raises(OptionError, match="it needs wavelength_nm,r,g,b"):
        parse_sensitivities(f"{head}\n400,1,1\n700,1,1\n".encode())


def test_a_blind_channel_is_refused() -> None:
    with pytest.raises(OptionError, match="must not be all zero"):
        parse_sensitivities(CAMERA.replace("550,0,1,0", "550,0,0,0").encode())


@pytest.mark.parametrize("index", [["R", "G"], ["B", "G", "R"], None])
def test_ampas_json_must_have_its_columns_in_order(ampas: bytes, index: Any) -> None:
    document = json.loads(ampas)
    document["spectral_data"]["index"]["main"] = index
    with pytest.raises(OptionError, match="it needs"):
        parse_sensitivities(json.dumps(document).encode())


def test_written_tables_are_read_back() -> None:
    nm = [380.0, 405.5, 700.0]
    light = Spectrum(wavelength_nm=nm, power=[0.0, 1.234567e-7, 3.0])
    assert parse_spectrum(write_spectrum(light)).power == [0.0, 1.23457e-7, 3.0]
    camera = Sensitivities(wavelength_nm=nm, r=[0.0, 0.5, -0.25], g=[1.0, 0.0, 0.0], b=[0.1] * 3)
    assert parse_sensitivities(write_sensitivities(camera)) == camera


TAKEN_WITH = TakenWith(make="NIKON", model="D5100", encoding="raw", upright=False, orientation=3)


def test_what_a_calibration_was_found_with_is_read_back() -> None:
    nm = [380.0, 700.0]
    light = Spectrum(wavelength_nm=nm, power=[1.0, 2.0], taken_with=TAKEN_WITH)
    assert parse_spectrum(write_spectrum(light)) == light
    curves = {"r": [0.0, 1.0], "g": [1.0, 1.0], "b": [1.0, 0.0]}
    camera = Sensitivities(wavelength_nm=nm, **curves, taken_with=TAKEN_WITH)
    assert parse_sensitivities(write_sensitivities(camera)) == camera


def test_other_tables_say_nothing_of_it(ampas: bytes) -> None:
    assert "taken_with" not in parse_spectrum(LIGHT.encode()).model_fields_set
    assert "taken_with" not in parse_sensitivities(ampas).model_fields_set
    light = Spectrum(wavelength_nm=[380.0, 700.0], power=[1.0, 2.0])
    assert b"taken_with" not in write_spectrum(light)


@pytest.mark.parametrize(
    "value", [5, "NIKON", [], {"model": 5}, {"orientation": 9}, {"encoding": "x"}, {"lens": ""}]
)
def test_a_table_that_says_it_amiss_is_refused_in_one_sentence(ampas: bytes, value: Any) -> None:
    document = {**json.loads(ampas), "taken_with": value}
    with pytest.raises(OptionError) as caught:
        parse_sensitivities(json.dumps(document).encode())
    assert str(caught.value) == (
        "The camera table does not say in taken_with what it was found with, as a calibration "
        "writes it: calibrate anew, or remove that."
    )
