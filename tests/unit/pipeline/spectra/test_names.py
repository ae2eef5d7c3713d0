from __future__ import annotations

import pytest

from pipeline.spectra.names import key_of, near_names, unknown


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("NIKON CORPORATION NIKON D5100", "Nikon D5100"),
        ("Canon Canon EOS 5D Mark II", "Canon 5D Mark II"),
        ("SONY ILCE-7M3", "Sony ILCE 7M3"),
        ("Canon_EOS-1Ds_Mark_III", "canon eos 1ds mark iii"),
        ("ЛАМПА_1", "лампа 1"),
        ("Caf\u00e9", "CAFE\u0301"),  # as macOS writes names of files
        ("\uff2e\uff29\uff2b\uff2f\uff2e", "Nikon"),  # of full width
    ],
)
def test_one_camera_has_one_key(written: str, meant: str) -> None:
    assert key_of(written) == key_of(meant)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("Nikon D5100", "Nikon D510"),
        ("Canon 5D Mark II", "Canon 5D Mark III"),
        ("FL2", "FL12"),
        ("лампа 1", "свет 1"),
        ("лампа", "свет"),
        ("灯", "室灯"),
    ],
)
def test_two_cameras_have_two_keys(one: str, other: str) -> None:
    assert key_of(one) != key_of(other)


def test_a_name_without_letters_and_digits_has_no_key() -> None:
    assert key_of("_ -!") == ""


def test_near_names_come_best_first_and_few() -> None:
    known = ["Nikon D5100", "Nikon D5300", "Nikon D5200", "Nikon D5000", "Nikon D70", "Sigma"]
    assert near_names("nikon d5101", known) == known[:4]
    assert near_names("zzz", known) == []


def test_long_names_are_cut_in_messages() -> None:
    assert len(unknown("camera", "y" * 10_000, ["Nikon"])) < 200


def test_of_a_long_name_only_the_beginning_is_looked_at() -> None:
    assert key_of("y" * 1_000_000) == "y" * 256
    assert key_of("Nikon D5100" + "-" * 244 + "x") == "nikond5100x"
