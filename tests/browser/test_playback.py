"""A recorded run in a real browser: it plays, stands, and is put to any time."""

import os
import re
import subprocess
import sys
import time

import pytest
from telerobot.config.load import load_cell
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

pytestmark = pytest.mark.browser

PATIENCE_MS = 180_000
STEPS = [
    {"at_s": 0.1, "cmd/joystick": {"twist": [0, 0.1, 0.05, 0, 0, 0.2]}, "for_s": 1.0},
    {"at_s": 1.5, "operator/mark": {"text": "<img src=x onerror=alert(1)>"}},
    {"at_s": 2.0, "operator/protective_stop": {}},
]


def until(page, so):
    """Wait until an expression of the page holds; its policy lets in no function made of text."""
    end_s = time.monotonic() + PATIENCE_MS / 1000
    while not page.evaluate(so):
        assert time.monotonic() < end_s, f"never: {so}"
        page.wait_for_timeout(50)


@pytest.fixture(scope="module")
def console(tmp_path_factory):
    """The address of the console of a recorded run, and the run."""
    file = tmp_path_factory.mktemp("run") / "run.mcap"
    script = Script.model_validate({"duration_s": 2.5, "step": STEPS})
    simulation = Simulation(load_cell("pa10"), script, file)
    simulation.run()
    child = subprocess.Popen(
        [sys.executable, "-m", "telerobot.tools.cli", "console", str(file), "--listen=127.0.0.1:0"],
        env={**os.environ, "TELEROBOT_CONSOLE_KEYS": "who-has-it-drives,who-has-it-watches"},
        stdout=subprocess.PIPE,
        text=True,
    )
    address = re.search(r"http\S+", child.stdout.readline())[0]
    yield address, simulation
    child.terminate()
    assert child.wait() == 0
    child.stdout.close()


def test_a_run_plays_and_is_put_to_the_time_of_an_event(browsers, console):
    address, simulation = console
    context = browsers(True).new_context(
        viewport={"width": 960, "height": 620}, device_scale_factor=0.3
    )
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    errors = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda told: told.type == "error" and errors.append(told.text))
    page.on("dialog", lambda dialog: errors.append(dialog.message))
    page.goto(address)
    page.wait_for_selector("body[data-shown]", state="attached")
    page.wait_for_selector("#scene canvas", state="attached")
    assert float(page.get_attribute("body", "data-shown")) == 0.0
    page.evaluate("document.getElementById('play').click()")
    until(page, "Number(document.body.dataset.shown) > 0.5")
    page.evaluate("document.getElementById('play').click()")
    until(page, "document.getElementById('play').textContent === 'Play'")
    stopped = page.locator(".events button", has_text="Protective stop").first
    stopped.evaluate("each => each.click()")
    until(page, "document.querySelector('.mode').textContent !== 'enabled'")
    shown = float(page.get_attribute("body", "data-shown"))
    told = next(e.time_s for e in simulation.events if e.name == "protective_stop")
    assert shown == pytest.approx(told - simulation.states[0].time_s, abs=0.06)
    slider = page.locator("#line input")
    slider.evaluate("each => { each.value = 1.2; each.dispatchEvent(new Event('input')); }")
    until(page, "document.querySelector('.mode').textContent === 'enabled'")
    assert float(page.get_attribute("body", "data-shown")) == pytest.approx(1.2, abs=0.05)
    ahead = page.locator(".events li.ahead").all_text_contents()
    assert any("Protective stop" in text for text in ahead)
    assert any("<img src=x" in text for text in ahead)
    assert errors == []
    context.close()


def test_a_recorded_run_is_plotted(browsers, console):
    address, _ = console
    page = browsers(False).new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.goto(address)
    page.wait_for_selector("body[data-shown]", state="attached")
    page.evaluate("document.getElementById('play').click()")
    until(page, "Number(document.body.dataset.shown) > 0.5")
    titles = page.locator(".plots-strip").inner_text()
    assert "Twist by source" in titles
    page.close()
