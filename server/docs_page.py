"""`/docs`: the OpenAPI description as one plain page. Without the Internet, as near many a robot, Swagger's page is blank."""

import json
from collections.abc import Iterator
from html import escape
from typing import Any

Json = dict[str, Any]

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem;
       color-scheme: dark; background: #14171c; color: #d9dee7 }
a { color: #7fb2ff } code, pre { font: 13px/1.45 ui-monospace, monospace }
pre { background: #0c0e12; padding: .7rem; border-radius: 6px; overflow-x: auto; margin: .4rem 0 }
section { border-top: 1px solid #2b313b; padding: .8rem 0 } h2 { margin-top: 2.2rem } h3 { margin: 0 }
table { border-collapse: collapse } td, th { text-align: left; padding: .1rem 1rem .1rem 0; vertical-align: top }
.method { color: #ffb454; display: inline-block; min-width: 4.5rem }
"""

_INTRODUCTION = """
<p>JSON, SI units, heading frame unless said; forces are those of the environment on the robot; quaternions are wxyz.
Unknown fields, wrong lengths, what is not finite and what is out of range: 422 with the field's name and the allowed range,
and nothing changes. A state that forbids the call: 409 with what to do. No control process: 503.</p>
<p>Machine-readable: <a href="openapi.json">openapi.json</a>.</p>
<h2>stream</h2>
<section><h3><code><span class="method">WS</span> /api/v1/stream?rate_hz=30&amp;fields=end_effector,loop</code></h3>
<p>Snapshots like those of <code>GET /api/v1/state</code>, newest only: a slow reader skips, never queues.
<code>rate_hz</code>: 1 to 100 (default 30). <code>fields</code>: names of the state's parts (default all);
<code>sequence</code>, <code>time_s</code>, <code>mode</code> and <code>faults</code> always come along.</p></section>
"""


def docs_page(description: Json) -> str:
    """HTML of an OpenAPI description whose calls carry examples."""
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
    return "\n".join(parts)


def _calls(description: Json) -> Iterator[tuple[str, str, Json]]:
    for path, methods in description["paths"].items():
        for method, call in methods.items():
            yield path, method.upper(), call


def _call(description: Json, path: str, method: str, call: Json) -> str:
    model = _request_model(description, call)
    examples = model.get("examples", [])
    for parameter in call.get("parameters", []):
        path = path.replace(f"{{{parameter['name']}}}", str(parameter["schema"]["examples"][0]))
    curl = f"curl -X {method} http://127.0.0.1:8080{path}"
    if examples:
        curl += f" -H 'Content-Type: application/json' \\\n  -d '{json.dumps(examples[0])}'"
    status, answer = next((status, answer) for status, answer in call["responses"].items() if status.startswith("2"))
    example = answer.get("content", {}).get("application/json", {}).get("example")
    others = ", ".join(status for status in call["responses"] if not status.startswith("2"))
    return (
        f'<section><h3><code><span class="method">{method}</span> {escape(path)}</code></h3>'
        f"<p>{escape(call.get('description', ''))}</p>{_fields(description, model)}"
        f"<pre>{escape(curl)}</pre>Answers {status}{' (or ' + others + ')' if others else ''}"
        + ("" if example is None else f"<pre>{escape(json.dumps(example, indent=1))}</pre>")
        + "</section>"
    )


def _request_model(description: Json, call: Json) -> Json:
    schema = call.get("requestBody", {}).get("content", {}).get("application/json", {}).get("schema", {})
    return _resolve(description, schema)


def _resolve(description: Json, schema: Json) -> Json:
    options = schema.get("anyOf", [schema])
    reference = next((option["$ref"] for option in options if "$ref" in option), None)
    return schema if reference is None else description["components"]["schemas"][reference.rsplit("/", 1)[1]]


def _fields(description: Json, model: Json) -> str:
    rows = []
    for name, schema in model.get("properties", {}).items():
        resolved = _resolve(description, schema)
        choices = ", ".join(map(repr, resolved.get("enum", [])))
        text = schema.get("description") or choices or resolved.get("description") or resolved.get("type", "")
        needed = "required" if name in model.get("required", []) else ""
        rows.append(f"<tr><td><code>{escape(name)}</code><td>{escape(text)}<td>{needed}")
    return f"<table>{''.join(rows)}</table>" if rows else ""
