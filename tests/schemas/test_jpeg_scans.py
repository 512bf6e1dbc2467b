import io

import pytest
from PIL import Image

from schemas.compression import MAX_MARKERS, scanned_pixels
from tests.schemas.pictures import SCAN, resized

BLOCK = 8 * 8


def jpeg(mode: str = "RGB", **options: object) -> bytes:
    buffer = io.BytesIO()
    Image.new(mode, (8, 8), 90).save(buffer, "JPEG", **options)
    return buffer.getvalue()


PROGRESSIVE = jpeg(progressive=True)


@pytest.mark.parametrize(
    ("mode", "options", "passes"),
    [("L", {}, 6), ("RGB", {}, 14), ("RGB", {"keep_rgb": True}, 18), ("CMYK", {}, 24)],
    ids=str,
)
def test_each_scan_goes_over_its_own_components(mode: str, options: dict[str, bool], passes: int) -> None:
    assert scanned_pixels(jpeg(mode, progressive=True, **options)) == passes * BLOCK


@pytest.mark.parametrize(("mode", "channels"), [("L", 1), ("RGB", 3), ("CMYK", 4)])
def test_a_baseline_file_has_one_scan_of_all_components(mode: str, channels: int) -> None:
    baseline = jpeg(mode)
    again = baseline[baseline.index(SCAN) : -2]
    assert scanned_pixels(baseline) == scanned_pixels(baseline[:-2] + again * 200) == channels * BLOCK


def test_scans_of_single_components_count_in_baseline_files_too() -> None:
    data = PROGRESSIVE.replace(b"\xff\xc2", b"\xff\xc0").replace(SCAN + b"\x00\x0c\x03", SCAN + b"\x00\x08\x01")
    assert scanned_pixels(data) == data.count(SCAN) * BLOCK


def test_decoders_go_over_whole_blocks() -> None:
    assert scanned_pixels(resized(PROGRESSIVE, 65_500, 1)) == 14 * 65_504 * 8
    assert scanned_pixels(resized(PROGRESSIVE, 9, 16)) == 14 * 16 * 16


def test_scans_of_other_pictures_do_not_count() -> None:
    within = b"\xff\xe1" + (len(PROGRESSIVE) + 2).to_bytes(2, "big") + PROGRESSIVE
    assert scanned_pixels(PROGRESSIVE[:2] + within + PROGRESSIVE[2:] + PROGRESSIVE) == 14 * BLOCK


@pytest.mark.parametrize("marker", [b"\xff\xd0", b"\xff\xff", b"\xff\x01", b"\xff\x00"])
def test_no_work_is_hidden_behind_markers(marker: bytes) -> None:
    at = PROGRESSIVE.index(SCAN)
    assert scanned_pixels(PROGRESSIVE[:at] + marker + PROGRESSIVE[at:]) == 14 * BLOCK


def test_markers_are_not_read_for_ever() -> None:
    with pytest.raises(ValueError, match=f"more than {MAX_MARKERS} markers"):
        scanned_pixels(PROGRESSIVE[:2] + b"\xff\xfe\x00\x02" * MAX_MARKERS)


def test_a_file_may_be_cut_off_anywhere() -> None:
    counts = [scanned_pixels(memoryview(PROGRESSIVE)[:size]) for size in range(len(PROGRESSIVE) + 1)]
    assert counts == sorted(counts)
    assert (counts[0], counts[-1]) == (0, 14 * BLOCK)
