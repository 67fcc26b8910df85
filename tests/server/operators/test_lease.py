from telerobot.protocols.proof import Proof, prove
from telerobot.server.operators.admission import Lease

FIRST, SECOND = bytes([1]) * 32, bytes([2]) * 32
KEY = "telerobot/cell/cmd/cancel"


def proven(lease, secret, epoch=1, seq=1, payload=b"x", key=KEY):
    return lease.proven_by(Proof.read(prove(secret, key, epoch, seq, payload)), KEY, b"x")


def test_nobody_holds_the_first_lease():
    assert not Lease().alive(0.0)
    assert Lease().expires_s == 0.0
    assert not proven(Lease(), b"", epoch=0)


def test_a_lease_lives_for_its_timeout_and_longer_when_renewed():
    lease = Lease().granted("ann", FIRST, now_s=10.0, timeout_s=0.5)
    assert lease.alive(10.49)
    assert not lease.alive(10.5)
    renewed = lease.renewed(10.4, 0.5)
    assert renewed.alive(10.89)
    assert not renewed.alive(10.9)
    assert (renewed.holder, renewed.secret, renewed.epoch) == ("ann", FIRST, lease.epoch)


def test_every_grant_is_a_new_epoch_even_after_an_end():
    first = Lease().granted("ann", FIRST, 0.0, 0.5)
    second = first.ended().granted("ann", SECOND, 1.0, 0.5)
    assert second.epoch == first.epoch + 1
    assert not proven(second, FIRST, epoch=2)


def test_only_the_holders_secret_proves_the_lease_for_one_key_and_content():
    lease = Lease().granted("ann", FIRST, 0.0, 0.5)
    assert proven(lease, FIRST)
    assert not proven(lease, SECOND)
    assert not proven(lease, b"")
    assert not proven(lease, FIRST, epoch=2)
    assert not proven(lease, FIRST, payload=b"y")
    assert not proven(lease, FIRST, key=KEY + "x")


def test_a_lease_that_ended_is_nobodys():
    ended = Lease().granted("ann", FIRST, 0.0, 0.5).ended()
    assert not ended.alive(0.0)
    assert not proven(ended, FIRST)
    assert not proven(ended, b"")
