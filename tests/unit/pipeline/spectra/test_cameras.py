"""Which sensitivities a frame gets, and how right they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.colour.spaces import XYZ_TO_SRGB
from pipeline.errors import OptionError
from pipeline.images.frames import Frame
from pipeline.options import Sensitivities, Spectrum
from pipeline.spectra.cameras import find_camera, measured_cameras, named_camera, srgb_stand_in
from pipeline.spectra.colour_science import colour_science
from pipeline.spectra.lights import find_light, reflectance_spectra
from pipeline.spectra.observer import cie_1931
from pipeline.spectra.tables import write_sensitivities, write_spectrum
from pipeline.spectra.wavelengths import WAVELENGTHS_NM
from pipeline.taken_with import TakenWith
from tests.angles import angles

FrameOf = Callable[..., Frame]
XYZ_TO_D700 = np.array(
    [[0.8139, -0.2171, -0.0663], [-0.8747, 1.6541, 0.2295], [-0.1925, 0.2008, 0.8093]]
)
"""A published daylight matrix of a real camera."""


@pytest.mark.parametrize(
    ("make", "model"),
    [
        ("NIKON CORPORATION", "NIKON D5100"),
        ("Nikon", "D5100"),
        ("nikon corporation", "nikon d5100"),
        ("", "Nikon D5100"),
    ],
)
@pytest.mark.parametrize("encoding", ["raw", "linear"])
def test_a_measured_camera_is_known_by_its_exif(
    frame_of: FrameOf, make: str, model: str, encoding: str
) -> None:
    camera = find_camera(None, frame_of(make, model, encoding))

    assert (camera.name, camera.source) == ("Nikon D5100", "measured")


def test_measured_sensitivities_are_those_of_the_table(frame_of: FrameOf) -> None:
    table = colour_science().MSDS_CAMERA_SENSITIVITIES["Nikon 5100 (NPL)"]
    at = int(np.flatnonzero(table.wavelengths == 550)[0])
    grid = int(np.flatnonzero(WAVELENGTHS_NM == 550)[0])

    camera = find_camera("Nikon D5100", frame_of())

    assert camera.sensitivities.shape == (3, 81)
    assert camera.sensitivities.max() == 1
    np.testing.assert_allclose(
        camera.sensitivities[:, grid], table.values[at] / table.values.max(), atol=0.01
    )
    assert WAVELENGTHS_NM[camera.sensitivities.argmax(1)].tolist() == pytest.approx(
        [600, 530, 460], abs=25
    )


@pytest.mark.parametrize("name", ["Sigma SD1 Merrill", "sd1 merrill", "Sigma SDMerill (NPL)"])
def test_a_name_asked_for_wins_over_exif(frame_of: FrameOf, name: str) -> None:
    camera = find_camera(name, frame_of("NIKON CORPORATION", "NIKON D5100", "srgb"))

    assert (camera.name, camera.source) == ("Sigma SD1 Merrill", "measured")


def test_a_camera_is_named_without_a_frame() -> None:
    named = named_camera("nikon corporation d5100")
    assert (named.name, named.source) == ("Nikon D5100", "measured")
    table = Sensitivities(wavelength_nm=[380, 780], r=[0, 4], g=[2, 2], b=[1, 0])
    given = named_camera(table)
    assert (given.name, given.source) == ("table", "file")
    assert given.sensitivities[:, -1].tolist() == [1, 0.5, 0]
    with pytest.raises(OptionError, match=r"^No camera is called '': send its table instead"):
        named_camera("")


@pytest.mark.parametrize(
    ("name", "near"),
    [("Nikon D5200", "Nikon D5100"), ("Nikkon D5100", "Nikon D5100"), ("sigma sd1", "Sigma SD1")],
)
def test_an_unknown_name_is_refused_with_near_ones(frame_of: FrameOf, name: str, near: str) -> None:
    with pytest.raises(OptionError, match=f"No camera is called '{name}': near names are .*{near}"):
        find_camera(name, frame_of())


@pytest.mark.parametrize("name", ["zzzzzzz", "", "x" * 5000, "../../etc/passwd", "\x00"])
def test_a_name_like_no_other_is_refused_with_a_way_out(frame_of: FrameOf, name: str) -> None:
    with pytest.raises(OptionError, match=r"^No camera is called .{0,90}: send its table instead"):
        find_camera(name, frame_of())


@pytest.mark.usefixtures("spectra_folder")
@pytest.mark.parametrize(
    ("make", "model", "name"),
    [
        ("Acme", "Acme One", "Acme One"),
        ("ACME CORPORATION", "One", "Acme One"),
        ("Canon", "Canon EOS 5D Mark II", "Canon EOS 5D Mark II"),
    ],
)
def test_the_folder_knows_more_cameras(frame_of: FrameOf, make: str, model: str, name: str) -> None:
    camera = find_camera(None, frame_of(make, model))

    assert (camera.name, camera.source) == (name, "measured")


@pytest.mark.usefixtures("spectra_folder")
@pytest.mark.parametrize(
    "make", ["RICOH IMAGING COMPANY, LTD.", "LEICA CAMERA AG", "EASTMAN KODAK COMPANY"]
)
def test_a_model_that_says_its_brand_names_a_camera_whatever_firm_made_it(
    frame_of: FrameOf, make: str
) -> None:
    """A model without a brand may be another firm's."""
    assert find_camera(None, frame_of(make, "ACME One")).name == "Acme One"
    assert find_camera(None, frame_of(make, "One")).source == "stand-in"
    assert find_camera(None, frame_of(make, "")).source == "stand-in"


@pytest.mark.usefixtures("spectra_folder")
def test_tables_keep_the_ratio_of_their_channels(frame_of: FrameOf) -> None:
    camera = find_camera("Acme One", frame_of())

    np.testing.assert_allclose(camera.sensitivities.max(1), [0.5, 1.0, 0.75], atol=1e-3)
    assert WAVELENGTHS_NM[camera.sensitivities.argmax(1)].tolist() == [600, 540, 460]


@pytest.mark.usefixtures("spectra_folder")
def test_near_names_come_from_the_folder_too(frame_of: FrameOf) -> None:
    with pytest.raises(OptionError, match="near names are Canon EOS 5D Mark II"):
        find_camera("Canon 5D Mark III", frame_of())


@pytest.mark.usefixtures("spectra_folder")
def test_a_light_is_no_near_camera_nor_a_camera_a_near_light(frame_of: FrameOf) -> None:
    with pytest.raises(OptionError, match=r"^No camera is called 'my torches': send its table"):
        find_camera("my torches", frame_of())
    with pytest.raises(OptionError, match=r"near names are my torch\b"):
        find_light("my torches")
    with pytest.raises(OptionError) as caught:
        find_light("Canon 5D Mark III")
    assert "Mark II" not in str(caught.value).replace("Mark III", "")


def test_two_cameras_of_one_name_are_refused(frame_of: FrameOf, spectra_folder: Path) -> None:
    """By EXIF, too; other cameras are found as before."""
    table = (spectra_folder / "more" / "Canon_EOS_5D_Mark_II.csv").read_bytes()
    (spectra_folder / "acme_one.csv").write_bytes(table)
    said = r"The files Acme_One_380_780_5\.json and acme_one\.csv .* have the same name"
    with pytest.raises(OptionError, match=said):
        find_camera("Acme One", frame_of())
    with pytest.raises(OptionError, match=said):
        find_camera(None, frame_of("ACME", "One"))
    assert find_camera("Canon 5D Mark II", frame_of()).name == "Canon EOS 5D Mark II"


def test_names_of_any_script_name_cameras(frame_of: FrameOf, spectra_folder: Path) -> None:
    table = (spectra_folder / "more" / "Canon_EOS_5D_Mark_II.csv").read_bytes()
    (spectra_folder / "ФЭД_5.csv").write_bytes(table)
    assert find_camera("фэд 5", frame_of()).name == "ФЭД 5"
    with pytest.raises(OptionError, match="No camera is called"):
        find_camera("ЛОМО 5", frame_of())


def test_a_light_is_no_camera(frame_of: FrameOf, spectra_folder: Path) -> None:
    assert (spectra_folder / "my_torch.csv").exists()
    with pytest.raises(OptionError, match="it needs wavelength_nm,r,g,b"):
        find_camera("my torch", frame_of())


def test_a_setting_that_names_no_folder_is_an_option_error(
    frame_of: FrameOf, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_SPECTRA", str(tmp_path / "nowhere"))
    with pytest.raises(OptionError, match="LIGHTLAYERS_SPECTRA names no folder"):
        find_camera("Nikon D5100", frame_of())


def test_a_file_that_is_used_unasked_is_named_where_it_cannot_be(
    frame_of: FrameOf, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "nikon_d5100.csv").write_text("wavelength_nm,R,G,B\n400,none,0,0\n")
    monkeypatch.setenv("LIGHTLAYERS_SPECTRA", str(tmp_path))
    with pytest.raises(OptionError, match=r"nikon_d5100\.csv .* cannot be used\. .* not a number"):
        find_camera(None, frame_of("NIKON CORPORATION", "NIKON D5100", encoding="raw"))

    def refuse(_path: Path) -> bytes:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_bytes", refuse)
    with pytest.raises(OptionError, match=r"nikon_d5100\.csv .* cannot be read: permission denied"):
        find_light("nikon d5100")


def test_a_table_handed_in_is_used_as_it_is(frame_of: FrameOf) -> None:
    table = Sensitivities(
        wavelength_nm=[400, 500, 600, 700], r=[0, 0, 4, 0], g=[0, 2, 0, 0], b=[1, 0, 0, 0]
    )

    camera = find_camera(table, frame_of("NIKON CORPORATION", "NIKON D5100"))

    assert camera.source == "file"
    np.testing.assert_allclose(camera.sensitivities.max(1), [1.0, 0.5, 0.25])
    assert camera.sensitivities[:, WAVELENGTHS_NM > 700].max() == 0


def test_a_table_that_sees_nothing_is_refused(frame_of: FrameOf) -> None:
    table = Sensitivities(wavelength_nm=[300, 350, 900], r=[1, 0, 0], g=[1, 0, 0], b=[1, 0, 0])
    with pytest.raises(OptionError, match="zero from 380 to 780 nm"):
        find_camera(table, frame_of())


def test_an_unmeasured_sensor_is_approximated_from_its_matrix(frame_of: FrameOf) -> None:
    """The promise is in colours: a color checker in daylight looks as the matrix says."""
    camera = find_camera(None, frame_of("NIKON CORPORATION", "NIKON D700", matrix=XYZ_TO_D700))
    lit = reflectance_spectra()[:24] * find_light("D65")

    assert (camera.name, camera.source) == ("NIKON CORPORATION NIKON D700", "approximate")
    assert camera.sensitivities.min() >= 0
    seen, said = lit @ camera.sensitivities.T, lit @ (XYZ_TO_D700 @ cie_1931()).T
    assert angles(seen, said).mean() < 2


@pytest.mark.parametrize("matrix", [None, XYZ_TO_D700])
def test_rendered_pictures_get_the_stand_in_whatever_took_them(
    frame_of: FrameOf, matrix: Floats64 | None
) -> None:
    frame = frame_of("NIKON CORPORATION", "NIKON D5100", "srgb", matrix)

    camera = find_camera(None, frame)

    assert camera is srgb_stand_in()
    assert (camera.name, camera.source) == ("sRGB", "stand-in")


def test_linear_files_that_say_their_colours_get_the_stand_in_whatever_took_them(
    frame_of: FrameOf,
) -> None:
    frame = replace(frame_of("NIKON CORPORATION", "NIKON D5100", "linear"), profiled=True)

    assert find_camera(None, frame) is srgb_stand_in()
    assert find_camera("Nikon D5100", frame).source == "measured"


def test_linear_files_of_an_unknown_camera_get_the_stand_in(frame_of: FrameOf) -> None:
    assert find_camera(None, frame_of(encoding="linear")) is srgb_stand_in()


def test_a_sensor_of_which_nothing_is_known_counts_as_a_typical_one(frame_of: FrameOf) -> None:
    camera = find_camera(None, frame_of("ACME", "Two"))

    assert (camera.name, camera.source) == ("typical sensor", "stand-in")
    np.testing.assert_array_equal(
        camera.sensitivities, find_camera("Nikon D5100", frame_of()).sensitivities
    )


@pytest.mark.parametrize("matrix", [np.zeros((3, 3)), -np.eye(3)], ids=["0", "-1"])
def test_a_sensor_with_the_matrix_of_none_counts_as_a_typical_one(
    frame_of: FrameOf, matrix: Floats64
) -> None:
    """Of negative numbers hardly any sensitivity is left."""
    found = find_camera(None, frame_of("ACME", "One", "raw", matrix))

    assert (found.name, found.source) == ("typical sensor", "stand-in")


def test_the_stand_in_sees_daylight_colours_as_srgb_shows_them() -> None:
    lit = reflectance_spectra()[:24] * find_light("D65")

    seen = lit @ srgb_stand_in().sensitivities.T
    shown = lit @ (XYZ_TO_SRGB @ cie_1931()).T

    assert np.median(angles(seen, shown)) < 1.5
    white = srgb_stand_in().sensitivities @ find_light("D65")
    np.testing.assert_allclose(white / white[1], 1.0, atol=0.01)


def test_sensitivities_cannot_be_changed_by_accident(frame_of: FrameOf) -> None:
    with pytest.raises(ValueError, match="read-only"):
        find_camera("Nikon D5100", frame_of()).sensitivities[0, 0] = 5


def test_measured_cameras_are_the_packaged_and_the_folders(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("LIGHTLAYERS_SPECTRA", raising=False)
    packaged = ["Nikon D5100", "Sigma SD1 Merrill"]
    assert [camera.name for camera in measured_cameras()] == packaged
    nm = [380.0, 500.0, 780.0]
    table = Sensitivities(wavelength_nm=nm, r=[0, 1, 2], g=[0, 2, 1], b=[2, 1, 0])
    (tmp_path / "My_Own_380_780_200.json").write_bytes(write_sensitivities(table))
    light = Spectrum(wavelength_nm=nm, power=[1, 1, 1])
    (tmp_path / "lamp.json").write_bytes(write_spectrum(light))
    monkeypatch.setenv("LIGHTLAYERS_SPECTRA", str(tmp_path))
    found = measured_cameras()
    assert [camera.name for camera in found] == [*packaged, "My Own"]
    assert found[2].sensitivities[:, 0] == pytest.approx([0, 0, 1])


def test_a_calibrated_camera_says_what_it_was_found_with(
    frame_of: FrameOf, spectra_folder: Path
) -> None:
    taken_with = TakenWith(make="NIKON", model="D5100", encoding="raw")
    nm, ones = [400.0, 500.0, 600.0, 700.0], [1.0, 1.0, 1.0, 1.0]
    r, b = [0.0, 0.0, 1.0, 1.0], [1.0, 1.0, 0.0, 0.0]
    table = Sensitivities(wavelength_nm=nm, r=r, g=ones, b=b, taken_with=taken_with)
    (spectra_folder / "refined.json").write_bytes(write_sensitivities(table))

    assert find_camera(table, frame_of()).taken_with == taken_with
    assert find_camera("refined", frame_of()).taken_with == taken_with
    assert find_camera("Nikon D5100", frame_of()).taken_with is None
