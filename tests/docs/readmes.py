"""The READMEs: that of the project and those of its folders, in the order in which one reads them."""

import re

from tests import HOME

FOLDERS = ("fivcore", "sweeps", "studies", "results", "tests")
NAMES = ("README.md", *(f"{folder}/README.md" for folder in FOLDERS))
TEXTS = {name: (HOME / name).read_text() for name in NAMES}
ALL = "\n".join(TEXTS.values())


def every(name: str) -> list[tuple[str, str]]:
    """Language and text of each block of code of a README, in its order."""
    return re.findall(r"```(\w+)\n(.*?)```", TEXTS[name], re.DOTALL)


def blocks(language: str, *names: str) -> list[str]:
    """Blocks of code in a language, of these READMEs or of all, in their order."""
    found = (re.findall(rf"```{language}\n(.*?)```", TEXTS[name], re.DOTALL) for name in names or NAMES)
    return [block for each in found for block in each]
