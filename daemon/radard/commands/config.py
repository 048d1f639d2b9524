"""`radard config`: check the configuration, show it with the origin of every value, its schema."""

import contextlib
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml

from radard.config.config import Config, load_with_origins
from radard.config.credentials import redact_value
from radard.config.options import add_options, config_options
from radard.config.sources import Places
from radard.errors import RadardError
from radard.judge.bundle import load_bundle
from radard.judge.model_choice import hop_warning, model_for
from x2radar.command import Parser, new_parser

_EXAMPLES = """\
examples:
  radard config check --config new.yaml
  RADARD_GATE__ADAPT_DB=30 radard config show --model none
  radard config schema > radard.schema.json
"""


def run(argv: Sequence[str]) -> int:
    args = make_parser().parse_args(argv)
    if args.what == "schema":
        print(json.dumps(Config.model_json_schema(), indent=2))
        return 0
    config, places = load_with_origins(args.config, options=config_options(args))
    if args.what == "show":
        print("\n".join(shown(config, places)))
    else:
        warnings = sorted(set(_warnings(config)))
        for text in warnings:
            sys.stderr.write(f"radard: {text}\n")
        print("configuration ok, but for the above" if warnings else "configuration ok")
    return 0


def _warnings(config: Config) -> Iterator[str]:
    """Yield what holds, but may not be meant; a model that is not here is not looked at."""
    for each in config.each():
        name = model_for(each.model.name)
        with contextlib.suppress(RadardError):
            if name != "none":
                bundle, own = load_bundle(name), each.model.profile
                yield from filter(None, [hop_warning(bundle, each.decision.hop_s, own)])
    for section, values in config.model_dump().items():
        for key, value in values.items() if isinstance(values, dict) else ():
            # Labels' file is made; what another user's folder holds is not known here.
            if isinstance(value, Path) and key.endswith("_file") and key != "labels_file":
                with contextlib.suppress(PermissionError):
                    if not value.exists():
                        yield f"{section}.{key}: {value}: no such file"


def make_parser() -> Parser:
    parser = new_parser("radard config", "Check or show the configuration that holds.", _EXAMPLES)
    parser.add_argument("what", choices=["check", "show", "schema"], help="what to do with it")
    add_options(parser)
    return parser


def shown(config: Config, places: Places) -> Iterator[str]:
    """Yield the lines of a YAML file for reading, with origins; secrets are masked."""
    for section, values in config.model_dump(mode="json").items():
        yield from _lines(places, (section,), values)


def _lines(places: Places, where: tuple[str, ...], value: Any) -> Iterator[str]:
    """Yield the lines of a value; a section that an entry of `sensors` lacks is the common one."""
    indent, is_entry = "  " * (len(where) - 1), where[0] == "sensors" and len(where) > 1
    if isinstance(value, dict) and (is_entry or not indent):
        yield f"{indent}{where[-1]}:" + ("" if value else " {}")
        for key, inner in value.items():
            yield from _lines(places, (*where, key), inner)
    elif value is not None or not is_entry:
        told = redact_value(where[-1], value)
        text = yaml.safe_dump(told, default_flow_style=True, width=10_000, allow_unicode=True)
        # A bare value is followed by the end of its document.
        text = text.removesuffix("...\n").strip()
        left = f"{indent}{where[-1]}: {text}"
        # What an entry of `sensors` does not say itself comes from the common section.
        place = places.get(where) or places.get(where[2:] if is_entry else where, "built-in")
        yield f"{left:<40} # {place}"
