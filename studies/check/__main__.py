"""Take what `fiv check` compares with from the reference: `python -m studies.check`."""

import json

from studies import results
from studies.check.installation import KNOWN, known_of

if __name__ == "__main__":
    KNOWN.write_text(json.dumps(known_of(results.reference_folder()), indent=1) + "\n", encoding="utf-8")
