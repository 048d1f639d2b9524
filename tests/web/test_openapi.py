"""docs/reference/openapi.yaml: a sound OpenAPI 3.1 file, and what a running daemon answers."""

import json
import re
from pathlib import Path

import pytest
import yaml
from jsonschema import Draft202012Validator, FormatChecker
from openapi_spec_validator import validate

from tests.dashboard_helpers import all_routes, post
from tests.web_helpers import HEADERS, Client, open_decision

PATH = Path(__file__).parents[2] / "docs" / "reference" / "openapi.yaml"
SPEC = yaml.safe_load(PATH.read_text("utf-8"))
PAGES = {"/", "/sw.js", "/ws", "/static"}
"""Routes that are no interface for programs."""


def resolved(node):
    """A part of the file, or what it refers to."""
    if "$ref" not in node:
        return node
    for key in node["$ref"].removeprefix("#/").split("/"):
        node = SPEC[key] if node is None or "$ref" in node else node[key]
    return node


def judge(method, template, answer):
    """Fail where an answer is not one that the file describes."""
    told = SPEC["paths"][template][method]["responses"]
    assert str(answer.status_code) in told, (method, template, answer.status_code, answer.text)
    content = resolved(told[str(answer.status_code)]).get("content", {})
    kind = answer.headers["content-type"].partition(";")[0]
    assert kind in content, (method, template, kind)
    if kind == "application/json":
        schema = content[kind]["schema"]
        # In one document with what it refers to.
        whole = {"components": SPEC["components"], **schema}
        judged = Draft202012Validator(whole, format_checker=FormatChecker())
        faults = [(f.json_path, f.message) for f in judged.iter_errors(answer.json())]
        assert (template, faults) == (template, [])


@pytest.fixture(scope="module")
def daemon(radard):
    """A daemon whose simulated person has raised an alarm, with a clip."""
    radard.wait(lambda: any(e["has_clip"] for e in radard.get("/api/v1/events")[1]["events"]))
    return radard


def test_the_file_is_openapi():
    assert SPEC["openapi"].startswith("3.1")
    validate(SPEC)


def test_it_has_every_route_and_no_other():
    routes = {}
    for route in all_routes():
        methods = getattr(route, "methods", None) or {"GET"}
        if route.path in PAGES:
            continue
        routes[re.sub(r":\w+\}", "}", route.path)] = {m.lower() for m in methods} - {"head"}
    assert {path: set(item) & {"get", "post"} for path, item in SPEC["paths"].items()} == routes


@pytest.mark.integration
@pytest.mark.parametrize("template", [p for p, item in SPEC["paths"].items() if "get" in item])
def test_every_get_answers_as_it_says(template, daemon):
    client = Client(daemon.port)
    events = client.get("/api/v1/events").json()["events"]
    id_ = next(each["id"] for each in events if each["has_clip"])
    judge("get", template, client.get(template.replace("{seq}", "1").replace("{id}", id_)))
    if "{" in template:
        gone = client.get(template.replace("{seq}", "9999999").replace("{id}", "0" * 26))
        assert gone.status_code == 404
        judge("get", template, gone)


@pytest.mark.integration
@pytest.mark.parametrize("query", ["kind=alarm&limit=1", "since=24h", "label=none", "kind=x"])
@pytest.mark.parametrize("path", ["/api/v1/events", "/api/v1/events/export"])
def test_every_filter(path, query, daemon):
    answer = Client(daemon.port).get(f"{path}?format=csv&{query}")
    assert answer.status_code == (400 if query == "kind=x" else 200)
    judge("get", path, answer)


POSTS = [
    (path, name, example["value"])
    for path, item in SPEC["paths"].items()
    for body in [item.get("post", {}).get("requestBody", {}).get("content", {})]
    for name, example in body.get("application/json", {}).get("examples", {}).items()
]


@pytest.mark.integration
@pytest.mark.parametrize(("path", "name", "value"), POSTS)
def test_every_example_of_a_post_is_taken(path, name, value, daemon):
    client = Client(daemon.port)
    if path == "/api/v1/labels":
        value = {**value, "event": client.get("/api/v1/events").json()["events"][0]["id"]}
    answer = post(client, path, value)
    judge("post", path, answer)
    # This is no replay, no token is named, and a real alarm may be on.
    refusals = {"/api/v1/playback": {409}, "/api/v1/login": {401}}
    refusals["/api/v1/test-alarm"] = {200, 400}
    assert answer.status_code in refusals.get(path, {200, 201, 202})
    refused = client.post(path, json.dumps(value).encode(), {"Content-Type": "application/json"})
    assert refused.status_code == 403
    judge("post", path, refused)


def test_there_is_an_example_of_every_post():
    without = {path for path, item in SPEC["paths"].items() if "post" in item}
    assert without - {path for path, _, _ in POSTS} == {"/api/v1/logout"}


def test_garbage_and_strangers(make):
    client = make(tokens=("a-token-to-look", "a-token-to-arm-with"))
    client.tell(open_decision(human=0.9))
    for path, item in SPEC["paths"].items():
        if "get" in item:
            judge("get", path, client.get(path.replace("{seq}", "1").replace("{id}", "0" * 26)))
        if "post" in item:
            judge("post", path, post(client, path, {}))
    armed = {**HEADERS, "Authorization": "Bearer a-token-to-arm-with"}
    for path in {path for path, _, _ in POSTS}:
        judge("post", path, client.post(path, b"[", armed))
