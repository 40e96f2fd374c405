"""`python -m studies` is `fiv`."""

from studies.cli import main

main()
