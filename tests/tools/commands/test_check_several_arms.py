"""`telerobot check` of several arms: each judged by its name, buses and distances by the cell's."""

import pytest
from telerobot.config.load import load_cell
from telerobot.tools.checks.findings import Severity
from telerobot.tools.checks.judge import judge
from telerobot.tools.cli import main


@pytest.fixture
def path(two_arms):
    """Path of a cell with two arms."""
    return two_arms()


def findings(path):
    return {f.check: f for f in judge(load_cell(path))}


def test_each_arm_is_judged_as_it_would_be_alone(path, capsys):
    found = findings(path)
    for part in load_cell(path).parts:
        alone = {f.check: f.text for f in judge(part)}
        own = {check: text for check, text in alone.items() if check.startswith(part.prefix)}
        assert len(own) > 20
        assert own == {check: found[check].text for check in own}
    assert {"left.s1 speed", "right.elbow torque", "left.holding start"} <= set(found)
    assert main(["check", str(path)]) == 0
    out = capsys.readouterr().out
    assert "right.posture ready" in out
    assert out.splitlines()[-1].endswith("0 errors, 0 warnings")


def test_the_load_of_a_bus_is_that_of_all_devices_on_it(path):
    apart = findings(path)
    shares = [apart[f"bus {bus} load"].values["load"] for bus in ("one", "other")]
    text = path.read_text().replace('bus = "other"', 'bus = "one"')
    path.write_text(
        text.replace(
            'like = "ur5e"',
            'like = "ur5e"\nforce_torque = { reply_ids = [3, 4], command_id = 0x65 }',
        )
    )
    with pytest.raises(Exception, match=r"mechanisms\[1\]\.drives\[0\]\.node: value \d+: already"):
        load_cell(path)
    nodes = "".join(
        f'[[mechanisms.drives]]\njoint = "{d.joint}"\nnode = {d.node + 20}\n'
        + "\n".join(
            f"{key} = {value!r}"
            for key, value in d.model_dump(
                exclude={"joint", "node", "bus"}, exclude_none=True
            ).items()
        )
        + "\n"
        for d in load_cell("ur5e").config.mechanism.drives
    )
    path.write_text(path.read_text() + nodes)
    both = findings(path)
    load = both["bus one load"].values
    assert {"left.force_torque", "right.force_torque"} <= set(load)
    once = 2 * (55 / 0.01 + 65 / 0.05) / 1e6  # SYNC and the daemon's heartbeat go out on each bus
    assert load["load"] == pytest.approx(sum(shares) - once / 2, rel=1e-6)
    assert both["bus other load"].values["load"] < 0.01


def test_arms_that_start_nearer_than_promised_are_an_error(path):
    found = findings(path)
    assert found["arms at start"].status is Severity.OK
    assert found["arms at start"].values["gap"] > 0.1
    path.write_text(path.read_text().replace("-0.6, 0.0", "0.35, 0.0"))
    near = findings(path)["arms at start"]
    assert near.status is Severity.ERROR
    assert near.values["gap"] < near.values["clearance"]
    assert "left." in near.text
    assert "right." in near.text
    assert main(["check", str(path)]) == 1


def test_arms_that_nothing_keeps_apart_are_worth_a_word(path):
    path.write_text(path.read_text() + "[avoidance]\nenabled = false\n")
    assert findings(path)["arms apart"].status is Severity.WARN


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("allowed_contacts = [{ link = 'hand', other = 'box' }]",
         "avoidance.allowed_contacts[0].link: value 'hand': no such link"),
        ("capsules = [{ link = 'link1', start = [0, 0, 0], end = [0, 0, 0.1], radius = 0.1 }]",
         "avoidance.capsules[0].link: value 'link1': no such link"),
    ],
)  # fmt: skip
def test_links_are_named_with_their_arm(path, more, words, capsys):
    path.write_text(path.read_text() + f"[avoidance]\n{more}\n")
    assert main(["check", str(path)]) == 2
    assert words in capsys.readouterr().err
    path.write_text(
        path.read_text().replace("'hand'", "'left.hand'").replace("'link1'", "'left.link1'")
    )
    assert main(["check", str(path)]) == 0
