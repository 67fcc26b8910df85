"""The papers, in the order of the page, and all their exhibits by name."""

from .chirikjian import CHIRIKJIAN
from .exhibit import Exhibit, Paper
from .hamaguchi import HAMAGUCHI
from .scott import SCOTT
from .williams import WILLIAMS
from .zhang import ZHANG

PAPERS: tuple[Paper, ...] = (WILLIAMS, SCOTT, HAMAGUCHI, ZHANG, CHIRIKJIAN)

EXHIBITS: dict[str, Exhibit] = {
    name: exhibit for paper in PAPERS for name, exhibit in paper.exhibits.items()
}
