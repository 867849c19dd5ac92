"""Calls generated from the console's own OpenAPI document by schemathesis: valid ones, and others that must be refused."""

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

CHECKS = {
    "not_a_server_error": "a server error",
    "negative_data_rejection": "an invalid input that was accepted",
    "status_code_conformance": "a status that the document does not tell",
    "response_schema_conformance": "an answer unlike its schema",
}
LEFT_OUT = ("put_backend", "restart_control", "take_lease")
"""The first two start another control process, which `soak_attacks.KILLS` does; thousands of calls would wait for it. With the
lease taken, all other calls would be refused."""

START_S = 60.0


class ToolMissingError(RuntimeError):
    """schemathesis is not installed; the message names the cure."""


class Generated(NamedTuple):
    """How many calls were made, and what each that failed was."""

    calls: int
    failures: list[str]

    def count(self, check: str) -> int:
        """Failures of one of CHECKS."""
        return sum(failure.startswith(check) for failure in self.failures)


def generated_calls(port: int, seed: int, duration_s: float) -> Generated:
    """Make calls for a while.

    Raises:
        ToolMissingError: schemathesis is not installed.
        RuntimeError: it made no report.
    """
    program = shutil.which("schemathesis", path=str(Path(sys.executable).parent)) or shutil.which("schemathesis")
    if program is None:
        raise ToolMissingError('the soak needs schemathesis; install it with `pip install -e ".[soak]"`')
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        command = [program, "run", f"http://127.0.0.1:{port}/openapi.json", "--max-time", str(max(1, round(duration_s)))]
        command += ["--phases", "coverage,fuzzing,stateful", "--checks", ",".join(CHECKS), "--max-failures", "1000"]
        command += ["--continue-on-failure", "--no-shrink", "--seed", str(seed), "--request-timeout", "60", "--warnings", "off"]
        command += ["--report", "json", "--report-json-path", str(report)]
        for operation in LEFT_OUT:
            command += ["--exclude-operation-id", operation]
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, timeout=duration_s + 2.0 * START_S, check=False
        )
        if not report.is_file():
            raise RuntimeError(f"schemathesis made no report: {(done.stderr or done.stdout)[-500:]}")
        content = json.loads(report.read_text())
    failures = [_in_words(failure) for failure in [*content["failures"], *content["errors"]]]
    return Generated(content["test_cases"]["generated"], failures)


def _in_words(failure: dict[str, object]) -> str:
    check = next((str(failure[key]) for key in ("check", "check_name", "type", "kind") if key in failure), "error")
    return f"{check}: {json.dumps(failure)[:300]}"
