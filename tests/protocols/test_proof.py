"""Agreement and proof, against the RFCs' own words in other code."""

import hmac
import struct
from hashlib import sha256

import pytest
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey, X25519PublicKey
from hypothesis import given, settings
from hypothesis import strategies as st
from telerobot.protocols.proof import PROOF_BYTES, KeyPair, Proof, prove, random_key

KEY = "telerobot/pa10/operator/lease"
ANN, DAEMON = KeyPair(bytes(range(32))), KeyPair(bytes(range(32, 64)))


def test_both_sides_make_the_same_secret_out_of_what_they_send_and_keep():
    ours = ANN.agree_with_daemon(DAEMON.public, KEY, 7)
    assert ours == DAEMON.agree_with_operator(ANN.public, KEY, 7)
    shared = X25519PrivateKey.from_private_bytes(bytes(range(32))).exchange(
        X25519PublicKey.from_public_bytes(DAEMON.public)
    )
    extracted = hmac.digest(bytes(32), shared, sha256)
    info = KEY.encode() + struct.pack(">Q", 7) + ANN.public + DAEMON.public
    assert ours == hmac.digest(extracted, info + b"\x01", sha256)


def test_a_secret_is_of_one_cell_one_epoch_and_two_keys():
    other = KeyPair(b"o" * 32)
    made = [
        ANN.agree_with_daemon(DAEMON.public, KEY, 7),
        ANN.agree_with_daemon(DAEMON.public, KEY, 8),
        ANN.agree_with_daemon(DAEMON.public, "telerobot/ur5e/operator/lease", 7),
        ANN.agree_with_daemon(other.public, KEY, 7),
        ANN.agree_with_operator(DAEMON.public, KEY, 7),
        other.agree_with_daemon(DAEMON.public, KEY, 7),
    ]
    assert len(set(made)) == len(made)


@pytest.mark.parametrize("public", [bytes(32), b"\x01" + bytes(31), b"short"])
def test_keys_that_make_no_secret_are_refused(public):
    with pytest.raises(ValueError, match=r"."):
        ANN.agree_with_operator(public, KEY, 1)


def test_no_two_random_keys_are_equal():
    assert len({random_key() for _ in range(100)}) == 100


def of_length(lengths):
    """Return bytes whose length is drawn first: by themselves they are drawn short."""
    return lengths.flatmap(lambda n: st.binary(min_size=n, max_size=n))


@given(of_length(st.integers(0, 300)), st.integers(0, 2**56 - 1), st.integers(0, 2**64 - 1))
def test_a_proof_is_the_digest_that_the_table_of_topics_promises(payload, epoch, seq):
    secret, key = b"s" * 32, "telerobot/pa10/cmd/jog"
    attached = prove(secret, key, epoch, seq, payload)
    numbers = struct.pack(">QQ", epoch, seq)
    assert attached == numbers + hmac.digest(secret, key.encode() + numbers + payload, sha256)[:16]
    proof = Proof.read(attached)
    assert (proof.epoch, proof.seq) == (epoch, seq)
    assert proof.holds(secret, key, payload)
    assert not proof.holds(secret, key + "x", payload)
    assert not proof.holds(secret, key, payload + b"x")
    assert not proof.holds(b"t" * 32, key, payload)


@given(of_length(st.integers(0, 80).filter(lambda n: n != PROOF_BYTES)))
def test_what_is_not_as_long_as_a_proof_is_none(attached):
    assert Proof.read(attached) is None


@pytest.mark.parametrize("length", [0, PROOF_BYTES - 1, PROOF_BYTES + 1, 2 * PROOF_BYTES])
def test_a_proof_with_a_byte_too_few_or_too_many_is_none(length):
    made = prove(b"s" * 32, "telerobot/pa10/cmd/jog", 1, 1, b"")
    assert Proof.read((2 * made)[:length]) is None
    assert Proof.read(made) is not None


def test_lengths_on_both_sides_of_a_proof_are_drawn():
    drawn = []

    @settings(max_examples=100, database=None, derandomize=True)
    @given(of_length(st.integers(0, 80).filter(lambda n: n != PROOF_BYTES)))
    def draw(attached):
        drawn.append(len(attached))

    draw()
    assert sum(n > PROOF_BYTES for n in drawn) >= 20
    assert sum(n < PROOF_BYTES for n in drawn) >= 20
