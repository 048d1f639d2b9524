"""Look up known vulnerabilities of what the daemon runs with; exit 1 if there are any.

Used by .ci/run with pip-audit's report on standard input. Where no database answers, as on a
machine without network, it says so and ends with 0.
"""

import json
import sys
from typing import Any


def verdict(text: str) -> tuple[int, str]:
    """Return exit code and message for a report of pip-audit, in JSON; empty if it has failed."""
    try:
        found: list[dict[str, Any]] = json.loads(text)["dependencies"]
    except (ValueError, LookupError, TypeError):
        return 0, "audit skipped: no database of vulnerabilities answers here"
    looked_up = [each for each in found if "skip_reason" not in each]
    if not looked_up:
        return 0, "audit skipped: the package index here has no list of vulnerabilities"
    bad = [
        f"{each['name']} {each['version']}: {', '.join(v['id'] for v in each['vulns'])}"
        for each in looked_up
        if each["vulns"]
    ]
    counts = f"audit: {len(looked_up)} of {len(found)} packages looked up"
    return (1, "\n".join([f"{counts}; known vulnerabilities:", *bad])) if bad else (0, counts)


if __name__ == "__main__":
    code, message = verdict(sys.stdin.read())
    sys.stderr.write(message + "\n")
    sys.exit(code)
