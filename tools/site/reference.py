"""Parts of the reference that are made from the program: commands, settings, records, routes."""

import contextlib
import io
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import messages
import yaml
from pydantic import BaseModel

from radard import cli as radard_cli
from radard.config.config import Config
from x2radar import cli as x2radar_cli
from x2radar.sim.module.faults import KINDS

ROOT = Path(__file__).resolve().parents[2]
OPENAPI = ROOT / "docs" / "reference" / "openapi.yaml"
_WIDTH = "88"
_WORDS = {
    "string": "text",
    "boolean": "`true`, `false`",
    "null": "`null`",
    "object": "a mapping",
}
_PYTHON = {
    "The driver": """
        x2radar.open x2radar.open_reconnecting x2radar.open_async
        x2radar.device.device.X2Radar x2radar.device.device.RadarStats
        x2radar.device.link.Deadlines x2radar.device.reconnect.ReconnectingRadar
        x2radar.device.reconnect.StreamEvent x2radar.device.aio.AsyncRadar
        x2radar.frame.Frame x2radar.frame.FastTimeAxis x2radar.frame.StreamInfo
        x2radar.modules.x2.RadarSettings x2radar.modules.x4.X4Settings
        x2radar.modules.profile.ProfileSettings x2radar.errors
    """,
    "Recordings": """
        x2radar.open_recording x2radar.read_frames x2radar.recording.blocks.BlockReader
        x2radar.recording.hdf5_writer.RecordingWriter
    """,
    "Frames in arrays": """
        x2radar.simulate x2radar.maps.range_time x2radar.maps.velocity_time
        x2radar.maps.spectrum radard.api.classify radard.api.features radard.api.spectrogram
        radard.api.FeatureWindow radard.api.Spectrogram radard.judge.decision.Decision
        radard.judge.classifier.Probabilities
    """,
    "Contracts of plug-ins": """
        radard.stream.source.FrameSource
        radard.outputs.base.Sink radard.outputs.base.SinkContext radard.outputs.registry.Opener
        radard.judge.features.FeatureMaker radard.judge.features.FeatureSettings
        radard.stream.ring.Dwell x2radar.sim.scene.cast.BodyKind x2radar.sim.points.Points
    """,
}
"""What programs of others use: the names whose docstrings are shown."""


def cli() -> str:
    """Return the help of every command and subcommand."""
    from x2train import cli as train_cli  # noqa: PLC0415 - torch takes seconds

    parts = []
    for name, main, option in (
        ("radard", radard_cli.main, "--help-all"),
        ("x2radar", x2radar_cli.main, "--help"),
        ("train-export", train_cli.main, "--help"),
    ):
        text = _help_of(main, option)
        parts += [f"## {name}\n", _block(text)]
        for command in _subcommands(name, text):
            parts += [f"### {name} {command}\n", _block(_help_of(main, command, "--help"))]
    return "\n".join(parts)


def _help_of(main: Callable[[list[str]], int], *argv: str) -> str:
    out = io.StringIO()
    before = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = _WIDTH
    try:
        with contextlib.redirect_stdout(out), contextlib.suppress(SystemExit):
            main(list(argv))
    finally:
        os.environ.pop("COLUMNS")
        if before is not None:
            os.environ["COLUMNS"] = before
    return out.getvalue()


def _subcommands(name: str, text: str) -> list[str]:
    """Return the names of the subcommands that a help lists."""
    if name == "radard":
        return list(radard_cli._COMMANDS)
    _, _, listed = text.partition("COMMAND\n")
    return re.findall(r"^    ([a-z][\w-]*)(?: |$)", listed, re.MULTILINE)


def _block(text: str) -> str:
    return f"```text\n{text.rstrip()}\n```\n"


def config() -> str:
    """Return a table for every section of the configuration."""
    parts = []
    for name, field in Config.model_fields.items():
        kind = field.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            parts.append(f"## {name}\n\n{_first_line(kind)}\n\n{_table(kind)}\n")
        else:
            default = _value(field.get_default(call_default_factory=True))
            about = field.description or ""
            parts.append(f"## {name}\n\n{_sentence(about)} Built in: `{default}`.\n")
    return "\n".join(parts)


def _first_line(kind: type[BaseModel]) -> str:
    return (kind.__doc__ or "").strip().partition("\n")[0]


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def _table(kind: type[BaseModel]) -> str:
    schema = kind.model_json_schema()
    rows = ["| key | built in | takes | |", "|---|---|---|---|"]
    for key, field in kind.model_fields.items():
        spec = schema["properties"][key]
        default = field.get_default(call_default_factory=True)
        takes = _takes(spec, schema.get("$defs", {})).replace("|", "\\|")
        about = (field.description or "").replace("|", "\\|")
        rows.append(f"| `{key}` | `{_value(default)}` | {takes} | {about} |")
    return "\n".join(rows)


def _value(value: Any) -> str:
    if isinstance(value, BaseModel):
        value = value.model_dump(mode="json")
    if isinstance(value, tuple):
        value = list(value)
    if isinstance(value, Path):
        value = str(value)
    return json.dumps(value).replace('"', "") if not isinstance(value, str) else value


def _takes(spec: Mapping[str, Any], known: Mapping[str, Any]) -> str:
    """Say in words what a JSON schema allows."""
    if "$ref" in spec:
        return _takes(known.get(spec["$ref"].rpartition("/")[2], {}), known)
    if "anyOf" in spec:
        return " or ".join(_takes(each, known) for each in spec["anyOf"])
    if "enum" in spec:
        return ", ".join(f"`{each}`" for each in spec["enum"])
    if "const" in spec:
        return f"`{_value(spec['const'])}`"
    kind = spec.get("type", "")
    if kind in {"number", "integer"}:
        return _range(spec, "a number" if kind == "number" else "a whole number")
    if kind == "array":
        inner = spec.get("items") or {}
        items = _takes(inner, known) if isinstance(inner, dict) and inner else ""
        return "[from, to]" if "prefixItems" in spec else f"a list of {items or 'values'}"
    return _WORDS.get(kind, kind or "any value")


def _range(spec: Mapping[str, Any], word: str) -> str:
    least = spec.get("minimum", spec.get("exclusiveMinimum"))
    most = spec.get("maximum", spec.get("exclusiveMaximum"))
    if least is not None and most is not None:
        above = "above " if "exclusiveMinimum" in spec else ""
        return f"{above}{least:g} to {most:g}"
    if least is not None:
        return f"above {least:g}" if "exclusiveMinimum" in spec else f"{least:g} or more"
    return word if most is None else f"up to {most:g}"


def records() -> str:
    """Return a table for every kind of record, from the schema of the JSON Lines."""
    text = (ROOT / "daemon" / "radard" / "output.schema.json").read_text("utf-8")
    known = json.loads(text)["$defs"]
    parts = []
    for name in ("hello", "decision", "event", "status"):
        spec = known[name]
        parts.append(f"### {name}\n\n| key | takes | always there |\n|---|---|---|")
        for key, inner in spec["properties"].items():
            takes = _schema_words(inner, known).replace("|", "\\|")
            always = "yes" if key in spec.get("required", ()) else ""
            parts.append(f"| `{key}` | {takes} | {always} |")
        parts.append("")
    return "\n".join(parts)


def _schema_words(spec: Mapping[str, Any], known: Mapping[str, Any]) -> str:
    if isinstance(spec.get("type"), list):
        return " or ".join(_takes({**spec, "type": each}, known) for each in spec["type"])
    if "$ref" in spec:
        return _schema_words(known[spec["$ref"].rpartition("/")[2]], known)
    if "enum" in spec:
        return ", ".join(f"`{json.dumps(each).strip(chr(34))}`" for each in spec["enum"])
    return _takes(spec, known)


def http() -> str:
    """Return a section for every path of the HTTP interface, from its OpenAPI file."""
    tree = yaml.safe_load(OPENAPI.read_text("utf-8"))
    return "\n".join(
        part for path, item in tree["paths"].items() for part in _path(path, item, tree)
    )


def _path(path: str, item: Mapping[str, Any], tree: Mapping[str, Any]) -> Iterator[str]:
    for method in ("get", "post"):
        if method not in item:
            continue
        spec = item[method]
        yield f"### {method.upper()} {path}\n"
        yield f"{spec['summary']}. {spec.get('description', '').strip()}\n"
        takes = [*item.get("parameters", ()), *spec.get("parameters", ())]
        if takes:
            yield "| parameter | in | |\n|---|---|---|"
            yield from (
                f"| `{each['name']}` | {each['in']} | {each.get('description', '')} |"
                for each in takes
                if "name" in each
            )
            yield ""
        body = spec.get("requestBody", {}).get("content", {}).get("application/json", {})
        for example in body.get("examples", {}).values():
            yield f"Body, as: `{json.dumps(example['value'])}`\n"
        told = (f"{code} {_told(answer, tree)}" for code, answer in spec["responses"].items())
        yield f"Answers: {'; '.join(told)}.\n"


def _told(answer: Mapping[str, Any], tree: Mapping[str, Any]) -> str:
    """Return what an answer is, in words that follow its code."""
    if "$ref" in answer:
        answer = tree["components"]["responses"][answer["$ref"].rpartition("/")[2]]
    text: str = answer["description"]
    return f"({text[:1].lower()}{text[1:]})"


def contributing() -> str:
    """Return CONTRIBUTING.md without its heading."""
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    return text.partition("\n")[2].strip()


def cards() -> str:
    """Return the cards of the bundles that ship, two headings lower."""
    texts = [path.read_text("utf-8") for path in sorted((ROOT / "models").glob("*.md"))]
    return "\n".join(re.sub(r"^#", "###", text, flags=re.MULTILINE) for text in texts)


def python() -> str:
    """Return what mkdocstrings makes the reference of Python names of."""
    parts = [
        f"### {title}\n\n" + "\n\n".join(f"::: {name}" for name in names.split())
        for title, names in _PYTHON.items()
    ]
    return "\n\n".join(parts)


def faults() -> str:
    """Return a table of what can go wrong with the simulated module."""
    rows = [f"| `{name}` | {kind.unit} | {kind.meaning} |" for name, kind in KINDS.items()]
    return "\n".join(["| kind | value | what happens |", "|---|---|---|", *rows])


def claims() -> str:
    """Return the claims of the threat model as a list."""
    made = yaml.safe_load((ROOT / "tests" / "claims.yaml").read_text("utf-8"))
    return "\n".join(f"* {claim}" for claim in made)


PARTS: Mapping[str, Callable[[], str]] = {
    "claims": claims,
    "cli": cli,
    "config": config,
    "records": records,
    "http": http,
    "python": python,
    "contributing": contributing,
    "cards": cards,
    "faults": faults,
    **messages.PARTS,
}
"""What a line `<!-- generated: NAME -->` of a page stands for."""
