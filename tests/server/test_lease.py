from telerobot.server.lease import Lease


def test_nobody_holds_the_first_lease():
    assert not Lease().alive(0.0)
    assert not Lease().proves("")


def test_a_lease_lives_for_its_timeout_and_longer_when_renewed():
    lease = Lease().granted("ann", "t1", now_s=10.0, timeout_s=0.5)
    assert lease.alive(10.49)
    assert not lease.alive(10.5)
    renewed = lease.renewed(10.4, 0.5)
    assert renewed.alive(10.89)
    assert not renewed.alive(10.9)
    assert (renewed.holder, renewed.token, renewed.epoch) == ("ann", "t1", lease.epoch)


def test_every_grant_is_a_new_epoch_even_after_an_end():
    first = Lease().granted("ann", "t1", 0.0, 0.5)
    second = first.ended().granted("ann", "t2", 1.0, 0.5)
    assert second.epoch == first.epoch + 1
    assert not second.proves("t1")


def test_only_the_holders_token_proves_the_lease():
    lease = Lease().granted("ann", "t1", 0.0, 0.5)
    assert lease.proves("t1")
    for wrong in ("", "t", "t11", "T1", "ţ1", "\ud800"):
        assert not lease.proves(wrong)


def test_a_lease_that_ended_is_nobodys():
    ended = Lease().granted("ann", "t1", 0.0, 0.5).ended()
    assert not ended.alive(0.0)
    assert not ended.proves("t1")
    assert not ended.proves("")
