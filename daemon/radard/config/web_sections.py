"""Section `web` of the configuration: the dashboard's tokens and limits."""

from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field


class WebSection(BaseModel):
    """The dashboard and its HTTP interface (-o http://HOST:PORT)."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    token_file: Path | None = Field(None, description="file with the token for looking on")
    token_env: str | None = Field(None, description="or variable that holds it")
    operator_token_file: Path | None = Field(None, description="token for arming, too")
    operator_token_env: str | None = Field(None, description="or variable that holds it")
    commands: bool = Field(True, description="false: nobody arms or labels from here")
    max_viewers: int = Field(32, ge=1, le=200, description="open pages at the same time")
    labels_file: Path | None = Field(None, description="null: labels.jsonl, state directory")
    sensors: dict[str, str] = Field(
        default_factory=dict, description="other dashboards to link to, name: URL"
    )
