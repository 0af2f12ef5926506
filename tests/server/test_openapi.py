"""The interface's own description: every route says what it does, shows an example, and names how it can fail."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from server.api import create_app
from server.config import Config
from server.live import Live, LiveOptions
from tests.server.live_session import HandSession

HTTP = Path(__file__).resolve().parents[2] / "docs" / "http.md"
HERE = "http://127.0.0.1:8000"
Json = dict[str, Any]


def described() -> Json:
    """What /openapi.json answers where a robot is served."""
    with TestClient(create_app(BY_HAND.bridge, further=LIVE.routers()), base_url=HERE) as client:
        return client.get("/openapi.json").json()


BY_HAND = HandSession()
LIVE = Live(LiveOptions(Config(), recordings=None), {"link0": BY_HAND.link}, BY_HAND.bridge.control)
SCHEMA = described()
ROUTES = [(path, method) for path, methods in SCHEMA["paths"].items() for method in methods]


def resolved(schema: Json) -> Json:
    """The schema behind a reference."""
    while "$ref" in schema:
        schema = SCHEMA["components"]["schemas"][schema["$ref"].rpartition("/")[2]]
    return schema


def without_example(schema: Json, name: str) -> Iterator[str]:
    """Names of the fields that a reader cannot picture: those without an example, default or fixed value."""
    schema = resolved(schema)
    if any(key in schema for key in ("examples", "example", "default", "const", "enum")):
        return
    if schema.get("type") == "null" or schema.get("type") == "boolean":
        return
    below = [*schema.get("anyOf", []), *schema.get("oneOf", [])]
    if schema.get("type") == "array" and "items" in schema:
        below.append(schema["items"])
    for part in below:
        yield from without_example(part, name)
    for key, field in schema.get("properties", {}).items():
        yield from without_example(field, f"{name}.{key}")
    if not below and "properties" not in schema:
        yield name


def faceless(content: Json, name: str) -> list[str]:
    """The same of a body: an example of the whole is as good, and pictures need none."""
    found: list[str] = []
    for media_type, body in content.items():
        is_text = "json" in media_type or media_type.startswith("text/")
        if is_text and "example" not in body and "examples" not in body:
            found += without_example(body.get("schema", {}), name)
    return found


@pytest.mark.parametrize(("path", "method"), ROUTES)
def test_a_route_says_what_it_does_and_how_it_fails(path: str, method: str):
    route = SCHEMA["paths"][path][method]
    assert path.startswith("/api/v1/")
    assert route["tags"]
    assert route["summary"]
    assert len(route["description"]) > 10
    answers = route["responses"]
    assert {"401", "403"} <= set(answers), "what the guard answers"
    successes = [answer for code, answer in answers.items() if code.startswith("2")]
    assert successes
    if "{" in path:
        assert "404" in answers, "what is named in the path may not be there"
    for code, answer in answers.items():
        assert answer["description"]
        if code == "422" or code == "204":
            continue
        assert faceless(answer.get("content", {}), f"{method} {path} {code}") == []
    for answer in successes:
        assert answer.get("content") or answers.get("204"), "it answers nothing, and does not say so"


@pytest.mark.parametrize(("path", "method"), ROUTES)
def test_what_a_route_takes_is_explained(path: str, method: str):
    route = SCHEMA["paths"][path][method]
    for parameter in route.get("parameters", []):
        name = f"{method} {path}: {parameter['name']}"
        assert parameter.get("description") or parameter["schema"].get("description"), f"{name} is not explained"
        if "example" not in parameter and "examples" not in parameter:
            assert list(without_example(parameter["schema"], name)) == []
    if "requestBody" in route:
        assert faceless(route["requestBody"]["content"], f"{method} {path} body") == []


def test_the_routes_that_are_promised_are_there():
    promised = {"status", "config", "config/schema", "profile", "map.png", "map.json", "commands", "health", "metrics"}
    assert {f"/api/v1/{name}" for name in promised} <= set(SCHEMA["paths"])


@pytest.mark.parametrize(("path", "method"), ROUTES)
def test_the_documents_name_every_route(path: str, method: str):
    text = HTTP.read_text()
    assert method.upper() in text
    for piece in path.removeprefix("/api/v1/").split("/"):
        name, _, suffix = piece.partition(".")
        if not piece.startswith("{"):
            assert re.search(rf"\b{name}\b", text), f"{piece} of {path}"
        assert suffix in text


def test_the_documents_name_every_topic():
    rows = set(re.findall(r"^\| `([\w/]+)` \|", HTTP.read_text(), re.MULTILINE))
    topics = {"notice", "status", "pose", "tile/K", *LIVE.bridge.layers.layers}
    assert topics <= rows


def test_operations_have_names_of_their_own():
    names = [SCHEMA["paths"][path][method]["operationId"] for path, method in ROUTES]
    assert len(names) == len(set(names))
