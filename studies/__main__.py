"""`python -m studies` is `fiv`."""

from studies.cli.main import main

main()
