"""The tests, beside the packages that they test; HOME is the checkout."""

from pathlib import Path

HOME = Path(__file__).parents[1]
