"""`/docs`: the OpenAPI description as one plain page. Without the Internet, as near many a robot, Swagger's page is blank."""

import json
import re
from collections.abc import Iterator
from html import escape
from typing import Any

from server.docs_fields import Field, fields_of, resolved

Json = dict[str, Any]

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem;
       color-scheme: dark; background: #14171c; color: #d9dee7 }
a { color: #7fb2ff } code, pre { font: 13px/1.45 ui-monospace, monospace }
pre { background: #0c0e12; padding: .7rem; border-radius: 6px; white-space: pre-wrap; margin: .4rem 0 }
section { border-top: 1px solid #2b313b; padding: .8rem 0 } h2 { margin-top: 2.2rem } h3 { margin: 0 }
table { border-collapse: collapse } td, th { text-align: left; padding: .1rem 1rem .1rem 0; vertical-align: top }
.method { color: #ffb454; display: inline-block; min-width: 4.5rem }
"""

_SMALL = 100

_INTRODUCTION = """
<p>JSON, SI units, heading frame unless said; forces are those of the environment on the robot; quaternions are wxyz.
Heading: origin on the ground below the base, x along the base's x axis projected on the ground, y to the left, z up.
What is not available or not finite is null. A command is <i>asked</i> for, and what acts of it after guidance, limits,
the tip-over limit and rate limits is <i>applied</i>.
Unknown fields, wrong lengths, what is not finite and what is out of range: 422 with the field's name and the allowed range,
and nothing changes. A state that forbids the call: 409 with what to do. No control process: 503.
HEAD answers wherever GET does.</p>
<p>Machine-readable: <a href="openapi.json">openapi.json</a>.</p>
<h2>stream</h2>
<section><h3><code><span class="method">WS</span> /api/v1/stream?rate_hz=30&amp;fields=end_effector,loop</code></h3>
<p>Snapshots like those of <code>GET /api/v1/state</code>, newest only: a slow reader skips, never queues.
<code>rate_hz</code>: 1 to 100 (default 30). <code>fields</code>: names of the state's parts (default all);
<code>sequence</code>, <code>time_s</code>, <code>mode</code> and <code>faults</code> always come along.</p></section>
"""


def pretty(value: Any) -> str:
    """JSON with every list of numbers or names, and every small object, on one line."""

    def joined(found: re.Match[str]) -> str:
        line = json.dumps(json.loads(found[0]))
        return line if line.startswith("[") or len(line) <= _SMALL else found[0]

    text = re.sub(r"\[\n[^\[\]{}]*\]", joined, json.dumps(value, indent=1))
    return re.sub(r"\{\n[^\[\]{}]*\}", joined, text)


def docs_page(description: Json) -> str:
    """HTML of an OpenAPI description whose schemas carry examples."""
    parts = [
        "<!doctype html><html lang=en><meta charset=utf-8><title>Forcelens API</title>",
        f"<link rel=icon href=static/icon.svg><style>{_STYLE}</style>",
        "<h1>Forcelens API, v1</h1>",
        _INTRODUCTION,
    ]
    group = None
    for path, method, call in _calls(description):
        if call["tags"][0] != group:
            group = call["tags"][0]
            parts.append(f"<h2>{escape(group)}</h2>")
        parts.append(_call(description, path, method, call))
    parts.append(_refusals(description))
    return "\n".join(parts)


def _calls(description: Json) -> Iterator[tuple[str, str, Json]]:
    for path, methods in description["paths"].items():
        for method, call in methods.items():
            yield path, method.upper(), call


def _call(description: Json, path: str, method: str, call: Json) -> str:
    request = _schema(call.get("requestBody", {}))
    asked = _example(description, request)
    for parameter in call.get("parameters", []):
        path = path.replace(f"{{{parameter['name']}}}", str(parameter["schema"]["examples"][0]))
    curl = f"curl -X {method} http://127.0.0.1:8080{path}"
    if asked is not None:
        curl += f" -H 'Content-Type: application/json' \\\n  -d '{json.dumps(asked)}'"
    status, answer = next((status, answer) for status, answer in call["responses"].items() if status.startswith("2"))
    answered = _example(description, _schema(answer))
    others = ", ".join(sorted(status for status in call["responses"] if not status.startswith("2")))
    return (
        f'<section id="{call["operationId"]}"><h3><code><span class="method">{method}</span> {escape(path)}</code></h3>'
        f"<p>{escape(call['description'])}</p>{_table(fields_of(description, request), 'required')}"
        f"<pre>{escape(curl)}</pre>Answers {status} (or {others})"
        + ("" if answered is None else f"<pre>{escape(pretty(answered))}</pre>")
        + _table(fields_of(description, _schema(answer)), "optional")
        + "</section>"
    )


def _schema(content: Json) -> Json:
    return content.get("content", {}).get("application/json", {}).get("schema", {})


def _example(description: Json, schema: Json) -> Any:
    if schema.get("type") == "array":
        return [_example(description, schema["items"])]
    return next(iter(resolved(description, schema).get("examples", [])), None)


def _refusals(description: Json) -> str:
    refusals: dict[str, tuple[str, Json]] = {}
    for _, _, call in _calls(description):
        for status, answer in call["responses"].items():
            content = answer.get("content", {}).get("application/json", {})
            if "example" in content:
                refusals[status] = answer["description"], content["example"]
    return "<h2>refusals</h2>" + "".join(
        f"<section><h3><code>{status}</code></h3><p>{escape(meaning)}</p><pre>{escape(pretty(example))}</pre></section>"
        for status, (meaning, example) in sorted(refusals.items())
    )


def _table(fields: Iterator[Field], marked: str) -> str:
    rows = "".join(
        f"<tr><td><code>{escape(field.path)}</code><td>{escape(field.kind)}<td>{escape(field.text)}"
        f"<td>{marked if field.required == (marked == 'required') else ''}"
        for field in fields
    )
    return f"<table>{rows}</table>" if rows else ""
