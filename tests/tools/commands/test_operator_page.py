import re

from telerobot import Operator
from telerobot.tools.commands.operator_page import PAGE, page


def test_the_page_of_the_operator_is_up_to_date():
    assert PAGE.read_text(encoding="utf-8") == page(), (
        "run python -m telerobot.tools.commands.operator_page"
    )


def test_the_page_has_everything_that_an_operator_can_do():
    told = set(re.findall(r"^### `(\w+)", page(), re.M))
    assert told == {name for name in dir(Operator) if not name.startswith("_")}
