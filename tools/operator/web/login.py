"""The two small pages before the page: who asks for the secret, and who leads on."""

from typing import Final

_HEAD: Final = (
    '<!doctype html><html lang="en"><head><meta charset="utf-8"><title>telerobot</title>'
    '<meta name="viewport" content="width=device-width"><link rel="icon" href="data:,">'
)

LOGIN: Final = (
    f"{_HEAD}</head><body><main><h1>telerobot console</h1>"
    "<p>Open the address that the console printed when it started, or type its key.</p>"
    '<form method="post" action="/login"><label>Key <input name="key" type="password" '
    'autocomplete="off" required></label> <button>Come in</button></form></main></body></html>'
)


def welcome() -> str:
    """Return the page that leads on to the address without the secret.

    A page of this origin, not a redirection: so a cookie for this site alone goes with it.
    """
    return (
        f'{_HEAD}<meta http-equiv="refresh" content="0;url=/"></head>'
        '<body><a href="/">On to the console</a></body></html>'
    )
