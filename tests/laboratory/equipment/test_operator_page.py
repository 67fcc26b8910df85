import re

from laboratory.equipment.operator_page import PAGE, page
from telerobot import Operator


def test_the_page_of_the_operator_is_up_to_date():
    assert PAGE.read_text(encoding="utf-8") == page(), (
        "run python -m laboratory.equipment.operator_page"
    )


def test_the_page_has_everything_that_an_operator_can_do():
    told = set(re.findall(r"^### `(\w+)", page(), re.M))
    assert told == {name for name in dir(Operator) if not name.startswith("_")}
