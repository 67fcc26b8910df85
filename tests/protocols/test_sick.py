"""Telegrams of a SICK scanner: a stream of bytes, and the scan in one of them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from telerobot.protocols.sick import (
    Scan,
    TelegramCutter,
    TelegramError,
    decode_scan,
    encode_scan,
    fault_in,
    framed,
)

SCAN = Scan(
    count=0x37,
    start_us=164_086,
    sent_us=166_515,
    frequency_hz=50.0,
    first_rad=math.radians(-45),
    step_rad=math.radians(0.5),
    distances=np.linspace(0.5, 3.0, 541).round(3),
)
CAPTURED = (
    "sRA LMDscandata 1 1 8D4C04 0 0 45FF 37 280F6 28A73 0 0 7 0 0 1388 168 0 1 DIST1 3F800000 "
    "00000000 FFF92230 1388 21D " + "7E 82 3 " * 180 + "7E 0 0 0 0 0 0"
)
"""As a real LMS111 sends it; 3 mm stands for no echo."""


def test_a_captured_telegram_is_read() -> None:
    scan = decode_scan(CAPTURED)
    assert (scan.count, scan.start_us, scan.sent_us) == (0x37, 0x280F6, 0x28A73)
    assert scan.frequency_hz == 50.0
    assert scan.first_rad == pytest.approx(math.radians(-45))
    assert scan.step_rad == pytest.approx(math.radians(0.5))
    assert len(scan.distances) == 541
    assert scan.distances[:2].tolist() == [0.126, 0.130]
    assert math.isnan(scan.distances[2])


def test_a_scan_survives_the_way_over_the_wire() -> None:
    sent = replace(SCAN, distances=np.where(np.arange(541) % 7, SCAN.distances, np.nan))
    got = decode_scan(encode_scan(sent))
    np.testing.assert_allclose(got.distances, sent.distances, atol=1e-9)
    assert {**vars(got), "distances": None} == {**vars(sent), "distances": None}


def test_remission_encoders_and_time_are_passed_over() -> None:
    words = encode_scan(SCAN).split(" ")
    words[18] = "1 5 FFFF"  # one encoder: its count and speed
    words[-6:-5] = ["1", "RSSI1", "3F800000", "00000000", "FFF92230", "1388", "2", "A", "B"]
    words[-2:] = ["1", "7DA", "1", "2", "3", "4", "5", "6", "0"]
    np.testing.assert_allclose(decode_scan(" ".join(words)).distances, SCAN.distances, atol=1e-9)


def spoilt(place: int, word: str) -> str:
    words = encode_scan(SCAN).split(" ")
    words[place] = word
    return " ".join(words)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (spoilt(1, "LMDscandatacfg"), "name: value 'LMDscandatacfg'"),
        (spoilt(2, "2"), "version: value '2': must be 1"),
        (spoilt(16, "0"), "scan frequency: value 0"),
        (spoilt(19, "0"), "channels: there is no DIST1|name of a channel|number of"),
        (spoilt(20, "DIST9"), "name of a channel: value 'DIST9'"),
        (spoilt(21, "7F800000"), "DIST1: scale: value inf"),
        (spoilt(24, "0"), "DIST1: angular step: value 0"),
        (spoilt(25, "FFFF"), "DIST1: number of rays: value 65535"),
        (spoilt(25, "220"), "position|number|rays|words"),
        (spoilt(30, "7EZ"), "DIST1: rays: value '7EZ': no number"),
        (spoilt(30, "12345"), "DIST1: rays: value '12345': must be 0 to FFFF"),
        (spoilt(30, ""), "DIST1: rays: value '': no number"),
        (encode_scan(SCAN) + " 0", "1 words too many"),
        (" ".join(encode_scan(SCAN).split(" ")[:200]), "DIST1: rays: 174 of 541 words are there"),
        (" ".join(encode_scan(SCAN).split(" ")[:9]), "time since start: the telegram ends"),
        ("", "kind of telegram"),
    ],
)
def test_a_malformed_scan_is_refused_by_the_name_of_its_field(words: str, complaint: str) -> None:
    with pytest.raises(TelegramError, match=complaint):
        decode_scan(words)


def test_no_spoilt_telegram_raises_anything_else() -> None:
    draw, whole = np.random.default_rng(4), bytearray(framed(encode_scan(SCAN)))
    refused = 0
    for _ in range(200):
        bad = bytearray(whole)
        for i in draw.integers(0, len(bad), 3).tolist():
            bad[i] = int(draw.integers(0, 256))
        for found in TelegramCutter().feed(bytes(bad)):
            try:
                if isinstance(found, TelegramError):
                    raise found
                decode_scan(found)
            except TelegramError:
                refused += 1
    assert refused > 100


def test_telegrams_are_cut_out_of_any_pieces_of_the_stream() -> None:
    stream = framed("sAN Run 1") + framed("sRA STlms 7 0") + framed("sSN x")
    for size in (1, 3, 7, len(stream)):
        frames, found = TelegramCutter(), []
        for i in range(0, len(stream), size):
            found += frames.feed(stream[i : i + size])
        assert found == ["sAN Run 1", "sRA STlms 7 0", "sSN x"]


def test_a_cut_telegram_costs_that_one_only() -> None:
    found = TelegramCutter().feed(
        b"rest\x03" + framed("a b")[:-2] + framed("c d") + b"\x02\xff\x03"
    )
    assert [str(x) for x in found] == [
        "5 bytes outside of a telegram",
        "a telegram was cut after 2 bytes",
        "c d",
        "byte 0 of a telegram is 0xff: no printable ASCII",
    ]


def test_a_telegram_without_an_end_does_not_fill_the_memory() -> None:
    frames = TelegramCutter()
    found = [x for _ in range(70) for x in frames.feed(b"\x02" + b"A" * 999)]
    assert all(isinstance(x, TelegramError) for x in found)
    endless = TelegramCutter()
    found = endless.feed(b"\x02" + b"A" * 70_000)
    assert ["has no end" in str(x) for x in found] == [True]


def test_errors_of_the_scanner_are_told_in_words() -> None:
    assert fault_in("sFA A") == "write access denied"
    assert fault_in("sFA 77") == "error 77"
    assert fault_in("sAN Run 1") is None
