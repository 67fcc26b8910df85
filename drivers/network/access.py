"""Zenoh's access control, as a router judges it: what each certificate may do, and nothing else.

A message passes a router twice: in by the rules of who sent it, out by the rules of who gets it.
What a subscriber or a queryable declares goes the other way, to those who may put or ask there,
or they would not know that somebody listens. Each key is allowed by itself: an expression with a
wildcard, of a stranger or not, is included in none and passes nothing. But those who hear of
obstacles hear of them by all senders, whose keys end with their names; and who sends a camera's
video may put on the keys of all cameras.
"""

from collections.abc import Iterable, Mapping

from ...protocols.roles import Grant, rights
from ...protocols.topics import Role

Grants = Mapping[str, Iterable[Grant]]
"""By the common name of a certificate."""

EVERYTHING = (
    "put", "delete", "declare_subscriber", "query", "reply", "declare_queryable",
    "liveliness_token", "liveliness_query", "declare_liveliness_subscriber",
)  # fmt: skip
"""All kinds of messages that Zenoh's access control knows."""


def enforced(holders: Grants) -> dict[str, object]:
    """Return a router's `access_control`: each certificate's rights, by its common name."""
    rules: list[dict[str, object]] = []
    policies: list[dict[str, object]] = []
    names: list[str] = []
    for name, grants in sorted(holders.items()):
        own = _rules(name, tuple(grants))
        if own:
            rules += own
            names.append(name)
            policies.append({"rules": [rule["id"] for rule in own], "subjects": [name]})
    return _control(rules, names, policies)


def reserved(cell: str) -> dict[str, object]:
    """Return the `access_control` of a daemon's own router that asks nobody for a certificate.

    Everybody may do what they like on it, but nobody takes the daemon's part: telemetry is put and
    requests are answered by none but the daemon's own session, and none but that hears commands.
    An expression with a wildcard is included in no rule: who listens on one hears nothing that is
    reserved, but who puts on one reaches all, so that readers hold to exact keys.
    """
    own, shown = (rights((Grant(cell, role),)) for role in (Role.DAEMON, Role.OBSERVER))
    rules = [
        _rule("telemetry", ("ingress",), ("put", "delete"), own.puts, "deny"),
        _rule("commands", ("egress",), ("put", "delete"), own.hears - shown.hears, "deny"),
        _rule("requests", ("egress",), ("query",), own.answers, "deny"),
        _rule("answers", ("ingress",), ("declare_queryable", "reply"), own.answers, "deny"),
    ]
    policy = {"rules": [rule["id"] for rule in rules], "subjects": ["everybody"]}
    return {
        "enabled": True,
        "default_permission": "allow",
        "rules": rules,
        "subjects": [{"id": "everybody"}],
        "policies": [policy],
    }


def trusting(servers: Iterable[str]) -> dict[str, object]:
    """Return a client's `access_control`: it talks to servers of these common names, or to nobody.

    Zenoh's clients believe any certificate that a public authority gave for the host's name. Those
    have other common names.
    """
    names = sorted(servers)
    rule = _rule("trusted", ("ingress", "egress"), EVERYTHING, ("**",))
    return _control([rule], names, [{"rules": ["trusted"], "subjects": names}])


def _control(
    rules: list[dict[str, object]], names: list[str], policies: list[dict[str, object]]
) -> dict[str, object]:
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": name, "cert_common_names": [name]} for name in names],
        "policies": policies,
    }


def _rules(name: str, grants: tuple[Grant, ...]) -> list[dict[str, object]]:
    may = rights(grants, name)
    every = (
        ("puts", "ingress", "put", may.puts),
        ("learns who hears", "egress", "declare_subscriber", may.puts),
        ("subscribes", "ingress", "declare_subscriber", may.hears),
        ("hears", "egress", "put", may.hears),
        ("asks", "ingress", "query", may.asks),
        ("learns who answers", "egress", "declare_queryable", may.asks),
        ("is answered", "egress", "reply", may.asks),
        ("serves", "ingress", "declare_queryable", may.answers),
        ("is asked", "egress", "query", may.answers),
        ("answers", "ingress", "reply", may.answers),
    )
    return [
        _rule(f"{name} {what}", (flow,), (message,), keys)
        for what, flow, message, keys in every
        if keys
    ]


def _rule(
    name: str,
    flows: Iterable[str],
    messages: Iterable[str],
    keys: Iterable[str],
    permission: str = "allow",
) -> dict[str, object]:
    return {
        "id": name,
        "permission": permission,
        "flows": list(flows),
        "messages": list(messages),
        "key_exprs": sorted(keys),
    }
