"""`serp studio`: a domain file in the browser, and beside it what it means, live.

`session` is all that the pages show, without a browser; `pages` draws it with NiceGUI; `serving`
and `guard` keep it to this machine and to whoever has the address.
"""
